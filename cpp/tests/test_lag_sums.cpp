// Sums over lags in closed form against sums lag by lag of the definition.
#include "gmwm/lag_sums.hpp"

#include <algorithm>
#include <cmath>
#include <complex>
#include <cstdint>
#include <cstdlib>
#include <numbers>
#include <vector>

#include "check.hpp"
#include "gmwm/hermite_sums.hpp"
#include "gmwm/lag_series.hpp"
#include "gmwm/lag_table.hpp"

namespace {

using Wide = long double;

struct Process {
  double white = 0, walk = 0;
  std::vector<double> spikes, amplitude_re, amplitude_im, decay_re, decay_im;
  std::vector<std::uint8_t> bare;

  void add(double re, double im, double decay, double angle, bool without_line = false) {
    amplitude_re.push_back(re), amplitude_im.push_back(im), decay_re.push_back(decay), decay_im.push_back(angle);
    bare.push_back(without_line);
  }
  gmwm::LagProcess view() const {
    return {white, walk, spikes, amplitude_re, amplitude_im, decay_re, decay_im, bare};
  }
  // The covariance of the running sum at the lags 0 … last.
  std::vector<Wide> running(std::int64_t last) const {
    std::vector<Wide> out;
    for (std::int64_t lag = 0; lag <= last; ++lag) {
      const Wide m = static_cast<Wide>(lag);
      Wide total = -0.5L * white * m + walk * (m * m * m - m) / 12;
      if (static_cast<std::size_t>(lag) < spikes.size()) total += spikes[static_cast<std::size_t>(lag)];
      for (std::size_t p = 0; p < decay_re.size(); ++p) {
        const std::complex<Wide> decay(decay_re[p], decay_im[p]), a(amplitude_re[p], amplitude_im[p]);
        const std::complex<Wide> half = std::sinh(decay / 2.0L), line = bare[p] ? 0.0L : 0.5L * m / std::tanh(decay / 2.0L);
        total -= (a * (line + std::exp(-decay * m) / (4.0L * half * half))).real();
      }
      out.push_back(total);
    }
    return out;
  }
};

Wide difference(const std::vector<Wide>& k, std::int64_t u, std::int64_t h, std::int64_t g) {
  Wide total = 0;
  for (int a = 0; a < 3; ++a)
    for (int b = 0; b < 3; ++b)
      total += (a == 1 ? -2 : 1) * (b == 1 ? -2 : 1) * k[static_cast<std::size_t>(std::abs(u - b * g + a * h))];
  return total;
}

void compare(const Process& left, const Process& right, double tolerance) {
  const std::int64_t samples = 200;
  const std::vector<std::int64_t> levels{1, 2, 3, 5, 7};
  std::vector<double> first(15), second(15), own_left(5), own_right(5), unused(5);
  const gmwm::LagProcess one = left.view(), two = right.view();
  gmwm::lag_sums(levels, samples, false, one, {}, {first, second});
  gmwm::lag_sums(levels, samples, true, one, {}, {unused, own_left});
  gmwm::lag_sums(levels, samples, true, two, {}, {unused, own_right});
  if (&left != &right) {
    const gmwm::LagTable table(levels, samples, false, two);
    const gmwm::TableFactor factor{&table, 0.5};
    std::vector<double> both(15);
    gmwm::lag_sums(levels, samples, false, one, {&factor, 1}, {first, both});
    for (std::size_t k = 0; k < both.size(); ++k) second[k] = both[k] - second[k];
  }
  const std::vector<Wide> k = left.running(2 * samples), l = right.running(2 * samples);
  for (std::size_t b = 0, place = 0; b < levels.size(); ++b)
    for (std::size_t a = 0; a <= b; ++a, ++place) {
      const std::int64_t h = std::int64_t{1} << (levels[a] - 1), g = std::int64_t{1} << (levels[b] - 1);
      Wide sum = 0, product = 0;
      for (std::int64_t u = 2 * g - samples; u <= samples - 2 * h; ++u) {
        const Wide n = static_cast<Wide>(samples - std::max<std::int64_t>(u, 0) - std::max(2 * h - 1, 2 * g - 1 - u));
        const Wide c = difference(k, u, h, g);
        sum += n * c;
        product += n * c * difference(l, u, h, g);
      }
      const double scale = std::pow(own_left[a] * own_left[b] * own_right[a] * own_right[b], 0.25);
      CHECK(std::abs(second[place] - static_cast<double>(product)) <= tolerance * scale);
      const double size = std::sqrt(200 * std::sqrt(own_left[a] * own_left[b]));
      CHECK(std::abs(first[place] - static_cast<double>(sum)) <= tolerance * size);
    }
}

void elementary() {
  Process white, walk, spikes, many;
  white.white = 1.5, walk.walk = 0.3, spikes.spikes = {1, -0.5, 0.25}, many.spikes.assign(12, 0.1);
  for (const Process& process : {white, walk, spikes}) compare(process, process, 1e-13);
  compare(white, walk, 1e-13);
  compare(spikes, walk, 1e-13);
  compare(many, walk, 1e-13);
  compare(walk, white, 1e-13);
}

// One exponential at a time: from white noise to a decay that is slow at most levels.
void exponentials() {
  for (const double decay : {30.0, 3.0, 0.6, 0.3, 0.1, 0.03, 0.01})
    for (const double angle : {0.0, 0.2, 1.5, std::numbers::pi}) {
      Process process;
      process.add(1.0, angle > 0 && angle < 3 ? 0.3 : 0.0, decay, angle);
      compare(process, process, 1e-9);
    }
  // Those whose period divides the scales.
  for (const double angle : {0.25, 0.5, 1.0}) {
    Process echo;
    echo.add(1.0, angle < 1 ? 0.3 : 0.0, 1e-3, angle * std::numbers::pi);
    compare(echo, echo, 1e-9);
  }
  Process bare;
  bare.add(0.7, 0, 1.2, 0, true);
  compare(bare, bare, 1e-12);
}

void mixtures() {
  Process one, two;
  one.white = 0.5, one.walk = 1e-4, one.spikes = {0.2, 0.1};
  one.add(1, 0, 0.3, 0), one.add(0.5, 0.1, 1e-3, 0.7), one.add(0.4, 0, 0.2, std::numbers::pi), one.add(1, 0, 0.02, 0);
  two.walk = 1e-3;
  two.add(1, 0, 0.01, 0), two.add(0.7, 0, 0.3, 0), two.add(0.5, 0, 2, 0, true);
  compare(one, one, 1e-11);
  compare(two, two, 1e-11);
  compare(one, two, 1e-11);
}

// Even powers of correlations.
void powers(const Process& process, std::int64_t samples, const std::vector<std::int64_t>& levels, double tolerance) {
  const std::vector<double> weights{0.5, 0.1, 0.01};
  const std::size_t size = levels.size();
  std::vector<double> variances(size), sums(size * (size + 1) / 2), own(size), same(size);
  gmwm::hermite_sums(levels, samples, false, process.view(), weights, {variances, sums});
  gmwm::hermite_sums(levels, samples, true, process.view(), weights, {same, own});
  const std::vector<Wide> k = process.running(2 * samples);
  for (std::size_t b = 0, place = 0; b < levels.size(); ++b)
    for (std::size_t a = 0; a <= b; ++a, ++place) {
      const std::int64_t h = std::int64_t{1} << (levels[a] - 1), g = std::int64_t{1} << (levels[b] - 1);
      const Wide square = difference(k, 0, h, h) * difference(k, 0, g, g);
      Wide sum = 0;
      for (std::int64_t u = 2 * g - samples; u <= samples - 2 * h; ++u) {
        const Wide n = static_cast<Wide>(samples - std::max<std::int64_t>(u, 0) - std::max(2 * h - 1, 2 * g - 1 - u));
        const Wide c = difference(k, u, h, g), x = c * c / square;
        sum += n * x * x * (0.5L + x * (0.1L + x * 0.01L));
      }
      CHECK(std::abs(sums[place] - static_cast<double>(sum)) <= tolerance * std::sqrt(own[a] * own[b]));
      if (a != b) continue;
      CHECK(sums[place] == own[a]);
      CHECK(std::abs(variances[a] - static_cast<double>(difference(k, 0, h, h))) <= 1e-9 * variances[a]);
    }
}

void powers_of_oscillations() {
  for (const double decay : {1.0, 0.1, 1e-3, 1e-6})
    for (const double angle : {0.02, 0.3, 1.5, std::numbers::pi / 2, 3.1, std::numbers::pi}) {
      Process process;
      process.white = 0.01, process.walk = 1e-7, process.spikes = {0.2, 0.1};
      process.add(1, 0, decay, angle), process.add(0.3, 0, 0.01, 0), process.add(0.3, 0, 1e-4, 0);
      powers(process, 1500, {1, 2, 4, 7, 9}, 1e-7);
    }
}

// In pieces of which rules take the mean over the phases of an oscillation, and at harmonics for which they cannot.
void powers_of_lasting_oscillations() {
  for (const double angle : {0.02, 0.3, 2 * std::numbers::pi / 3 + 1e-4, 2.7}) {
    Process process;
    process.white = 0.01, process.walk = 1e-9;
    process.add(1, 0.1, 1e-11, angle), process.add(0.3, 0, 0.5, 0), process.add(0.3, 0, 2e-5, 0), process.add(1, 0, 0.02, 1.1);
    powers(process, 60000, {5, 13}, 1e-7);
  }
}

// Sums of falling powers and exponentials, and of powers, against sums lag by lag.
void falling_powers() {
  for (const std::int64_t n : {17, 400})
    for (const gmwm::Complex decay : {gmwm::Complex{1, 0}, {0.1, 0.7}, {0.05, 3.1}}) {
      const gmwm::Falling falling(static_cast<double>(n));
      const gmwm::Complex one{1, 0}, z = gmwm::exp(-decay), a{0.3, -0.2}, b{0.5, 0.1};
      const std::complex<Wide> wide(decay.re, decay.im), wide_a(a.re, a.im), wide_b(b.re, b.im);
      gmwm::Falling::Values sums{};
      falling.add(z, gmwm::exp(-(static_cast<double>(n) * decay)), gmwm::inverse(z - one), a, b, 6, sums);
      const gmwm::Falling::Values powers = falling.powers(sums, 6);
      for (std::size_t r = 0; r <= 6; ++r) {
        Wide expected[2] = {0, 0};
        for (std::int64_t i = 0; i < n; ++i) {
          const Wide lag = static_cast<Wide>(i), last = static_cast<Wide>(n - 1 - i);
          Wide function = 1, power = 1;
          for (std::size_t s = 0; s < r; ++s) function *= (lag - static_cast<Wide>(s)) / n, power *= lag / n;
          const Wide value = (wide_a * std::exp(-lag * wide) + wide_b * std::exp(-last * wide)).real();
          expected[0] += function * value, expected[1] += power * value;
        }
        CHECK(std::abs(sums[r] - static_cast<double>(expected[0])) <= 1e-9);
        CHECK(std::abs(powers[r] - static_cast<double>(expected[1])) <= 1e-9);
      }
    }
}

}  // namespace

int main() {
  return check::at_each_level("lag_sums", [] {
    elementary();
    exponentials();
    mixtures();
    falling_powers();
    powers_of_oscillations();
    powers_of_lasting_oscillations();
  });
}
