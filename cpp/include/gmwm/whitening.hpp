// Innovations of a filter with constant gain: a cascade of second-order sections, and the effect of the unknown initial
// state, which is estimated by recursive least squares.
#pragma once

#include <cstddef>
#include <span>

namespace gmwm {

// One section y_t = b0 x_t + s1, s1 = b1 x_t - a1 y_t + s2, s2 = b2 x_t - a2 y_t after another, in place.
// sections: b0, b1, b2, 1, a1, a2 of each; state: s1, s2 of each, which are updated.
void second_order_sections(std::span<const double> sections, std::span<double> state, std::span<double> x);

// Innovations e_t = ε_t + g_t·u of one frame with the prior information I and moments M of u, so that I⁻¹ M is its mean.
// Writes (e_t - g_t·û_t) / √(1 + g_t·I_t⁻¹ g_t) over e, with û_t and I_t from the samples before t; 0 where the variance
// g_t·I_t⁻¹ g_t exceeds `unknown`. Adds the frame to information (m, m) and moments (m).
// responses: g_t, row by row.
void least_squares_innovations(std::span<const double> responses, double unknown, std::span<double> information,
                               std::span<double> moments, std::span<double> e);

}  // namespace gmwm
