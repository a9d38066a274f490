// Local optima of a sum of processes over the coordinates of their shapes, by variable projection: non-negative least
// squares eliminates the scales (Golub and Pereyra 1973), Levenberg-Marquardt and then Newton steps move the coordinates.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "gmwm/arma.hpp"
#include "gmwm/exponential_curve.hpp"
#include "gmwm/exponential_search.hpp"

namespace gmwm {

// Wavelet variances of a process with unit scale as a function of coordinates, which are limited to the range low … high.
class Shape {
 public:
  Shape(std::vector<double> low, std::vector<double> high) : low_(std::move(low)), high_(std::move(high)) {}
  virtual ~Shape() = default;

  std::size_t size() const { return low_.size(); }
  double low(std::size_t k) const { return low_[k]; }
  double high(std::size_t k) const { return high_[k]; }

  // Writes the variances (J,); false if there is no such process.
  virtual bool values(const double* z, double* out) const = 0;
  // Writes their derivatives (size, J).
  virtual void slopes(const double* z, double* out) const = 0;

 private:
  std::vector<double> low_, high_;
};

// A branch of processes with exponential autocovariances.
class ExponentialShape final : public Shape {
 public:
  explicit ExponentialShape(ExponentialCurve curve);
  bool values(const double* z, double* out) const override;
  void slopes(const double* z, double* out) const override;

 private:
  ExponentialCurve curve_;
};

// An ARMA process at ascending levels; the coordinates are artanh of the partial autocorrelations of its polynomials.
class ArmaShape final : public Shape {
 public:
  ArmaShape(const ArmaOrders& orders, std::span<const std::int64_t> levels, std::span<const double> odd,
            std::vector<double> low, std::vector<double> high);
  bool values(const double* z, double* out) const override;
  void slopes(const double* z, double* out) const override;

 private:
  template <class Number>
  std::vector<Number> coefficients(std::vector<Number> z) const;

  ArmaOrders orders_;
  std::vector<std::int64_t> levels_;
  std::vector<double> odd_;
};

// A damped oscillator under Haar's filter; the coordinates are ln f and ln(Q - 1/2), with f in cycles per sample.
class OscillatorShape final : public Shape {
 public:
  OscillatorShape(std::span<const double> half_scales, double rate, std::vector<double> low, std::vector<double> high);
  bool values(const double* z, double* out) const override;
  void slopes(const double* z, double* out) const override;

 private:
  std::vector<double> half_scales_;
  double rate_;
};

// Shapes of all processes: a branch for each curved process and its coordinate, then all coordinates of the free ones.
struct ShapePoint {
  std::vector<std::size_t> branches;
  std::vector<double> x;
};

// The smallest objective of given shapes: weights of all unit vectors, the unit vectors of processes with a shape, and the
// lengths of their weighted variances.
struct Projected {
  double objective = 0;
  ShapePoint point;
  std::vector<double> weights, units, lengths, residual;
};

// Second derivatives of the objective for the coordinates that `able` marks.
struct Curvature {
  std::vector<char> able;
  std::vector<double> hessian;
};

class Descent {
 public:
  // The target and the rows of `fixed` are weighted; `rounding`: length of the rounding error of the residual.
  Descent(std::span<const double> target, std::span<const double> fixed, std::span<const double> root, double rounding);
  Descent(Descent&&) = default;

  void add_branch(std::unique_ptr<Shape> shape) { branches_.push_back(std::move(shape)); }
  void add_free(std::unique_ptr<Shape> shape) { frees_.push_back(std::move(shape)); }

  std::size_t dim() const { return target_.size(); }
  std::size_t branches() const { return branches_.size(); }
  // The number of coordinates of a point with this number of curved processes.
  std::size_t coordinates(std::size_t curved) const;

  // The optimal weights at a point; nothing if there is no such process.
  std::optional<Projected> at(ShapePoint point) const;
  // The point that at most `steps` Levenberg-Marquardt steps reach.
  Projected downhill(Projected best, std::size_t steps) const;
  // The optimum after Newton steps, and the last second derivatives, kept from `curvature` until steps converge slowly.
  Projected sharpened(Projected best, std::optional<Curvature>& curvature) const;
  // Whether the gradient is a rounding error of the lengths of the vectors that it multiplies.
  bool at_rest(const Projected& found) const;

 private:
  const Shape& shape(const ShapePoint& point, std::size_t k) const;
  std::vector<double> slopes(const Projected& found) const;
  std::vector<double> gradient(const Projected& found, const std::vector<double>& slopes) const;
  std::vector<char> moving(const Projected& found, const std::vector<double>& gradient) const;
  ShapePoint moved(const ShapePoint& point, const std::vector<double>& step) const;
  void project(const Projected& found, std::vector<double>& rows) const;
  bool second_derivatives(const Projected& best, const std::vector<char>& able, std::vector<double>& hessian) const;
  bool as_low(double objective, double least) const;

  std::vector<double> target_, fixed_;
  Root root_;
  double rounding_;
  std::vector<std::unique_ptr<Shape>> branches_, frees_;
};

}  // namespace gmwm
