#include <nanobind/nanobind.h>

#include "gmwm/pause.hpp"

namespace nb = nanobind;

void bind_arma(nb::module_& m);
void bind_descent(nb::module_& m);
void bind_exponential(nb::module_& m);
void bind_haar(nb::module_& m);
void bind_kalman(nb::module_& m);
void bind_cone(nb::module_& m);
void bind_clusters(nb::module_& m);
void bind_robust(nb::module_& m);
void bind_sketch(nb::module_& m);
void bind_pyramid(nb::module_& m);
void bind_lags(nb::module_& m);
void bind_lag_sums(nb::module_& m);
void bind_paths(nb::module_& m);
void bind_polynomial(nb::module_& m);
void bind_whitening(nb::module_& m);
void bind_outliers(nb::module_& m);
void bind_spectral_shape(nb::module_& m);
void bind_json_text(nb::module_& m);

namespace {

// Python looks for Ctrl-C on its main thread only. There, KeyboardInterrupt ends the kernel.
void interrupt() {
  const nb::gil_scoped_acquire acquire;
  if (PyErr_CheckSignals() != 0) throw nb::python_error();
}

}  // namespace

NB_MODULE(_core, m) {
  gmwm::interruption = &interrupt;
  m.doc() = "The C++ kernels: arrays and sizes in, arrays out; what they mean is stated in Python.";
  // A command ends without a search for reference cycles, and its accumulators may be in some. That is no leak.
  nb::set_leak_warnings(false);
  bind_arma(m);
  bind_descent(m);
  bind_exponential(m);
  bind_haar(m);
  bind_kalman(m);
  bind_cone(m);
  bind_clusters(m);
  bind_robust(m);
  bind_sketch(m);
  bind_pyramid(m);
  bind_lags(m);
  bind_lag_sums(m);
  bind_paths(m);
  bind_polynomial(m);
  bind_whitening(m);
  bind_outliers(m);
  bind_spectral_shape(m);
  bind_json_text(m);
}
