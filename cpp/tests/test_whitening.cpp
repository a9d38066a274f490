// Sections against the recursion of the whole filter, and innovations against the likelihood of all samples together.
#include "gmwm/whitening.hpp"

#include <cmath>
#include <span>
#include <vector>

#include "check.hpp"

namespace {

void sections_are_one_filter() {
  // (1 - 0.5 z)(1 + 0.2 z) / ((1 - 0.9 z)(1 + 0.3 z)) in one section and in two.
  const std::vector<double> one{1, -0.3, -0.1, 1, -0.6, -0.27};
  const std::vector<double> two{1, -0.5, 0, 1, -0.9, 0, 1, 0.2, 0, 1, 0.3, 0};
  std::vector<double> x(50), y, state_one(2), state_two(4);
  for (std::size_t t = 0; t < x.size(); ++t) x[t] = std::sin(0.7 * static_cast<double>(t * t));
  y = x;
  gmwm::second_order_sections(one, state_one, x);
  // In two chunks.
  gmwm::second_order_sections(two, state_two, std::span<double>{y}.first(20));
  gmwm::second_order_sections(two, state_two, std::span<double>{y}.subspan(20));
  for (std::size_t t = 0; t < x.size(); ++t) CHECK_CLOSE(x[t], y[t], 1e-12);
}

// Four sections of a cascade run together, and the others together.
void a_cascade_is_its_sections_one_after_another() {
  for (const std::size_t count : {5u, 6u, 7u}) {
    std::vector<double> sections, x(50), state(2 * count), alone(2 * count);
    for (std::size_t k = 0; k < count; ++k) {
      const double a = 0.1 * static_cast<double>(k);
      sections.insert(sections.end(), {1, a, -0.05, 1, a - 0.4, 0.2 * a});
    }
    for (std::size_t t = 0; t < x.size(); ++t) x[t] = std::cos(0.3 * static_cast<double>(t * t));
    std::vector<double> y = x;
    gmwm::second_order_sections(sections, state, x);
    for (std::size_t k = 0; k < count; ++k)
      gmwm::second_order_sections(std::span{sections}.subspan(6 * k, 6), std::span{alone}.subspan(2 * k, 2), y);
    CHECK(x == y);
    CHECK(state == alone);
  }
}

// The squares of the innovations and the logarithms of their variances add up to those of e ~ N(0, 1 + G P Gᵀ), here
// for one state, where they are closed forms.
void innovations_have_the_likelihood() {
  const double prior = 0.25, decay = 0.8;
  std::vector<double> g, e, information{1 / prior}, moments{0};
  double squares = 0, product = 0, energy = 0;
  for (int t = 0; t < 12; ++t) {
    g.push_back(std::pow(decay, t));
    e.push_back(std::cos(1.3 * t));
    squares += e.back() * e.back();
    product += g.back() * e.back();
    energy += g.back() * g.back();
  }
  gmwm::least_squares_innovations(g.data(), 12, 1e9, information, moments, e);
  double sum = 0;
  for (const double z : e) sum += z * z;
  CHECK_CLOSE(sum, squares - product * product / (1 / prior + energy), 1e-12);
  CHECK_CLOSE(information[0], 1 / prior + energy, 1e-14);
  CHECK_CLOSE(moments[0], product, 1e-14);
}

// Two states with one response each are one state; a part whose variance is unknown has no innovation.
void states_add_up() {
  std::vector<double> g, both, e, f, information{2}, moments{0}, wider{4, 0, 0, 4}, two(2);
  for (int t = 0; t < 12; ++t) {
    g.push_back(1.0 / (1 + t));
    e.push_back(std::sin(2.0 * t));
  }
  both = g;
  both.insert(both.end(), g.begin(), g.end());
  f = e;
  gmwm::least_squares_innovations(g.data(), 12, 1e9, information, moments, e);
  gmwm::least_squares_innovations(both.data(), 12, 1e9, wider, two, f);
  for (std::size_t t = 0; t < e.size(); ++t) CHECK_CLOSE(e[t], f[t], 1e-12);
  std::vector<double> diffuse{1e-12}, none{0}, level(3, 1.0), x{5, 5, 6};
  gmwm::least_squares_innovations(level.data(), 3, 1e9, diffuse, none, x);
  CHECK(x[0] == 0);
  CHECK(std::abs(x[1]) < 1e-9);
  CHECK_CLOSE(x[2], 1 / std::sqrt(1.5), 1e-9);
}

// Frames of four samples, of a state that decays and one that is constant, against all responses at once; and the
// decayed state is left out at the end.
void frames_are_one_signal() {
  constexpr std::size_t frame = 4, samples = 64;
  std::vector<double> responses, g, e, whole{2, 0, 0, 4}, moments(2);
  for (const double decay : {0.7, 1.0})
    for (std::size_t t = 0; t < samples; ++t) {
      if (t < frame) responses.push_back(std::pow(decay, t));
      g.push_back(std::pow(decay, t));
    }
  for (std::size_t t = 0; t < samples; ++t) e.push_back(std::sin(2.0 * static_cast<double>(t)));
  std::vector<double> f = e;
  gmwm::least_squares_innovations(g.data(), samples, 1e9, whole, moments, e);
  const std::vector<double> step{std::pow(0.7, frame), 0, 0, 1};
  gmwm::InitialState state{{1, 0, 0, 1}, {2, 0, 0, 4}, {0, 0}, 0};
  std::span<double> rest = f;
  for (const std::size_t n : {1u, 2u, 7u, 54u}) {
    gmwm::subtract_initial_state(responses, step, 1e9, 1e-12, state, rest.first(n));
    rest = rest.subspan(n);
  }
  for (std::size_t t = 0; t < samples; ++t) CHECK_CLOSE(e[t], f[t], 1e-6);
  CHECK(state.count == samples);
  CHECK(state.moments.size() == 1);
  CHECK_CLOSE(state.power[1], 1.0, 1e-14);
  // The information of the constant alone: that of both minus what the other one takes.
  CHECK_CLOSE(state.information[0], whole[3] - whole[1] * whole[1] / whole[0], 1e-6);
}

void blocks_are_means_of_squared_coefficients() {
  std::vector<double> sums(999);  // more blocks than are computed together
  for (std::size_t t = 0; t < sums.size(); ++t) sums[t] = std::cos(0.3 * static_cast<double>(t * t));
  for (const std::size_t m : {2u, 4u, 8u}) {
    const std::vector<double> found = gmwm::block_mean_squares(sums, m, 9);
    CHECK(found.size() == (sums.size() - m + 1) / 9);
    for (std::size_t b = 0; b < found.size(); ++b) {
      double squares = 0.0;
      for (std::size_t i = 9 * b; i < 9 * b + 9; ++i) {
        double w = 0.0;
        for (std::size_t k = 0; k < m; ++k) w += k < m / 2 ? -sums[i + k] : sums[i + k];
        squares += w * w;
      }
      CHECK_CLOSE(found[b], squares / 9, 1e-13);
    }
  }
  CHECK(gmwm::block_mean_squares(std::span{sums}.first(3), 4, 2).empty());
}

}  // namespace

int main() {
  return check::at_each_level("whitening", [] {
    sections_are_one_filter();
    a_cascade_is_its_sections_one_after_another();
    innovations_have_the_likelihood();
    states_add_up();
    frames_are_one_signal();
    blocks_are_means_of_squared_coefficients();
  });
}
