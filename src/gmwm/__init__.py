"""Stochastic calibration of inertial sensors by the Generalized Method of Wavelet Moments.

Recordings
    `read` reads a file, `stream` reads a file of any size in chunks, and `inspect` checks whether a recording can
    be used. A recording is an `Imu`, a mapping of axis to `Signal`; `imu.write(path)` writes it.
Calibration
    `calibrate` finds the noise model of every axis and its datasheet numbers; the result writes the report and the
    files for other programs. `agree` compares calibrations of one unit, and `fleet` calibrates many units.
Monitoring
    A `Monitor` watches a sensor at rest and reports when its noise or its level changes.
Variances
    `wavelet_variance`, `allan_variance`, `hadamard_variance` and `total_variance` measure a signal; `avlr` computes
    datasheet numbers from the slopes of the Allan deviation. `WaveletAccumulator` measures samples as they arrive.
    `psd` estimates the power spectral density, and finds lines and resonances in it. `cross` tests whether axes have
    common noise, `fit_joint` models it, and `fuse` combines an array of sensors into one virtual sensor. `same` tests
    whether two recordings have the same noise. `contamination` tests for outliers, and `compare` draws curves and fits
    in one plot.
Models
    A `Model` is a sum of processes, `2 * GM() + WN()` or `Model.parse("2*GM + WN")`. `fixed` holds a parameter at a
    value. `fit` estimates a model by the GMWM, and `fit_ml` by maximum likelihood; `select` and `rank` choose among
    models; `plan` computes how long to record.
Simulation
    `simulate` makes a recording with known noise, and `simulate_signal` a single signal.
    `gmwm.simulation.reference_imu` gives the models of a typical unit.

Results, errors and functions for special purposes are in the packages: `gmwm.errors`, `gmwm.filters`, `gmwm.spectrum`,
`gmwm.covariance`, `gmwm.datasheets`, `gmwm.estimation`, `gmwm.inference`, `gmwm.likelihood`, `gmwm.exporters`.

All values are in SI units: rad/s and m/s² for signals, s for times, Hz for rates. Parameters of processes are per
sample (a white noise variance σ² is the variance of one sample), except the inverse correlation time β of a
Gauss-Markov process, which is in 1/s. Levels are numbered from 1; the scale of level j is τ_j = 2^j samples. The Allan
variance at the averaging time τ_j / 2 is twice the Haar wavelet variance ν_j².
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    # Packages of results and special purposes that nothing below imports.
    from gmwm import exporters as exporters
    from gmwm import reports as reports
    from gmwm.calibration import Calibration, agree, calibrate
    from gmwm.errors import GmwmError
    from gmwm.estimation import Fit, fit
    from gmwm.fleets import fleet
    from gmwm.inference import plan
    from gmwm.inspection import inspect
    from gmwm.joint import cross, fit_joint, fuse, same  # type: ignore[no-redef]  # modules have these names too
    from gmwm.likelihood import fit_ml
    from gmwm.monitor import Monitor
    from gmwm.outliers import contamination
    from gmwm.plots import compare
    from gmwm.processes import (
        AR,
        AR1,
        ARMA,
        DR,
        FGN,
        FN,
        GM,
        MA,
        MAT,
        PL,
        QN,
        RW,
        SARMA,
        SIN,
        WN,
        Model,
        fixed,
    )  # fmt: skip
    from gmwm.readers import read, stream
    from gmwm.selection import rank, select
    from gmwm.signals import Imu, Signal
    from gmwm.simulation import simulate, simulate_signal
    from gmwm.spectrum import psd
    from gmwm.variance import (
        WaveletAccumulator,
        WaveletVariance,
        allan_variance,
        avlr,
        hadamard_variance,
        total_variance,
        wavelet_variance,
    )

__version__ = "0.1.0"

__all__ = [
    "AR",
    "AR1",
    "ARMA",
    "DR",
    "FGN",
    "FN",
    "GM",
    "MA",
    "MAT",
    "PL",
    "QN",
    "RW",
    "SARMA",
    "SIN",
    "WN",
    "Calibration",
    "Fit",
    "GmwmError",
    "Imu",
    "Model",
    "Monitor",
    "Signal",
    "WaveletAccumulator",
    "WaveletVariance",
    "agree",
    "allan_variance",
    "avlr",
    "calibrate",
    "compare",
    "contamination",
    "cross",
    "fit",
    "fit_joint",
    "fit_ml",
    "fixed",
    "fleet",
    "fuse",
    "hadamard_variance",
    "inspect",
    "plan",
    "psd",
    "rank",
    "read",
    "same",
    "select",
    "simulate",
    "simulate_signal",
    "stream",
    "total_variance",
    "wavelet_variance",
]  # fmt: skip

_NAMES = {
    "calibration": ("Calibration", "agree", "calibrate"),
    "errors": ("GmwmError",),
    "estimation": ("Fit", "fit"),
    "fleets": ("fleet",),
    "inference": ("plan",),
    "inspection": ("inspect",),
    "joint": ("cross", "fit_joint", "fuse", "same"),
    "likelihood": ("fit_ml",),
    "monitor": ("Monitor",),
    "outliers": ("contamination",),
    "plots": ("compare",),
    "readers": ("read", "stream"),
    "selection": ("rank", "select"),
    "signals": ("Imu", "Signal"),
    "simulation": ("simulate", "simulate_signal"),
    "spectrum": ("psd",),
    "variance": (
        "WaveletAccumulator", "WaveletVariance", "allan_variance", "avlr", "hadamard_variance", "total_variance",
        "wavelet_variance",
    ),
}  # fmt: skip
"""Names of `__all__` by package; the others are in `gmwm.processes`, whose processes define their names. A package is
imported only when one of its names is used, because the import of all packages takes 0.4 s."""

if not TYPE_CHECKING:

    def __getattr__(name: str) -> Any:
        """Import a name of `__all__` or a package."""
        if name in __all__:
            package = next((package for package, names in _NAMES.items() if name in names), "processes")
            found = globals()[name] = getattr(import_module(f"gmwm.{package}"), name)
            return found
        if not name.startswith("_"):
            try:
                return import_module(f"gmwm.{name}")
            except ModuleNotFoundError as error:
                if error.name != f"gmwm.{name}":
                    raise
        raise AttributeError(f"module 'gmwm' has no attribute {name!r}")

    def __dir__() -> list[str]:
        return sorted({*globals(), *__all__} - {"Any", "TYPE_CHECKING", "import_module"})
