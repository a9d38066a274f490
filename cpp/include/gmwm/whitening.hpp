// Innovations of a filter with constant gain: a cascade of second-order sections, and the effect of the unknown initial
// state, which is estimated by recursive least squares.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace gmwm {

// One section y_t = b0 x_t + s1, s1 = b1 x_t - a1 y_t + s2, s2 = b2 x_t - a2 y_t after another, in place.
// sections: b0, b1, b2, 1, a1, a2 of each; state: s1, s2 of each, which are updated.
void second_order_sections(std::span<const double> sections, std::span<double> state, std::span<double> x);

// Innovations e_t = ε_t + g_t·u of one frame with the prior information I and moments M of u, so that I⁻¹ M is its mean.
// Writes (e_t - g_t·û_t) / √(1 + g_t·I_t⁻¹ g_t) over e, with û_t and I_t from the samples before t; 0 where the variance
// g_t·I_t⁻¹ g_t exceeds `unknown`. Adds the frame to information (m, m) and moments (m).
// responses: component k of g_t is at k stride + t.
void least_squares_innovations(const double* responses, std::size_t stride, double unknown,
                               std::span<double> information, std::span<double> moments, std::span<double> e);

// What is known of the m components u of the initial state of a filter with p states.
struct InitialState {
  std::vector<double> power;                 // (p, m) state at the first sample of the present frame for each component
  std::vector<double> information, moments;  // (m, m) and (m), as above
  std::size_t count = 0;                     // samples so far
};

// Subtracts the effect of the initial state from innovations e as above, frame by frame. responses: (p, frame) of the
// innovations of a frame to the state at its first sample; step: (p, p), the transition over a frame. At the end of each
// frame, components whose effect on an innovation has at most the mean square `negligible` are integrated out.
void subtract_initial_state(std::span<const double> responses, std::span<const double> step, double unknown,
                            double negligible, InitialState& state, std::span<double> e);

// Mean squares of Haar coefficients in blocks of `length`: the second half of m consecutive sums minus the first half;
// m is a power of two.
std::vector<double> block_mean_squares(std::span<const double> sums, std::size_t m, std::size_t length);

}  // namespace gmwm
