// Sections against the recursion of the whole filter, and innovations against the likelihood of all samples together.
#include "gmwm/whitening.hpp"

#include <cmath>
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

// Four sections of a cascade run together, and the others one by one.
void a_cascade_is_its_sections_one_after_another() {
  std::vector<double> sections, x(50), state(14), alone(14);
  for (int k = 0; k < 7; ++k) sections.insert(sections.end(), {1, 0.1 * k, -0.05, 1, 0.1 * k - 0.4, 0.02 * k});
  for (std::size_t t = 0; t < x.size(); ++t) x[t] = std::cos(0.3 * static_cast<double>(t * t));
  std::vector<double> y = x;
  gmwm::second_order_sections(sections, state, x);
  for (std::size_t k = 0; k < 7; ++k)
    gmwm::second_order_sections(std::span{sections}.subspan(6 * k, 6), std::span{alone}.subspan(2 * k, 2), y);
  CHECK(x == y);
  CHECK(state == alone);
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
  gmwm::least_squares_innovations(g, 1e9, information, moments, e);
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
    both.insert(both.end(), 2, 1.0 / (1 + t));
    e.push_back(std::sin(2.0 * t));
  }
  f = e;
  gmwm::least_squares_innovations(g, 1e9, information, moments, e);
  gmwm::least_squares_innovations(both, 1e9, wider, two, f);
  for (std::size_t t = 0; t < e.size(); ++t) CHECK_CLOSE(e[t], f[t], 1e-12);
  std::vector<double> diffuse{1e-12}, none{0}, level(3, 1.0), x{5, 5, 6};
  gmwm::least_squares_innovations(level, 1e9, diffuse, none, x);
  CHECK(x[0] == 0);
  CHECK(std::abs(x[1]) < 1e-9);
  CHECK_CLOSE(x[2], 1 / std::sqrt(1.5), 1e-9);
}

}  // namespace

int main() {
  return check::at_each_level("whitening", [] {
    sections_are_one_filter();
    a_cascade_is_its_sections_one_after_another();
    innovations_have_the_likelihood();
    states_add_up();
  });
}
