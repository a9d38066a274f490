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
variance at the averaging time τ_j / 2 is twice the Haar wavelet variance ν_j²."""

import sys
from importlib import import_module
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from gmwm.applications import fleets as fleets
    from gmwm.applications import monitor as monitor
    from gmwm.applications import navigation as navigation
    from gmwm.applications import several as several
    from gmwm.applications.fleets import fleet
    from gmwm.applications.monitor import Monitor
    from gmwm.applications.several import cross, fit_joint, fuse, same
    from gmwm.base import errors as errors
    from gmwm.base import remarks as remarks
    from gmwm.base import time_base as time_base
    from gmwm.base import units as units
    from gmwm.base.errors import GmwmError
    from gmwm.calibration import Calibration, agree, calibrate
    from gmwm.choosing import datasheets as datasheets
    from gmwm.choosing import replicates as replicates
    from gmwm.choosing import selection as selection
    from gmwm.choosing.selection import rank, select
    from gmwm.files import importers as importers
    from gmwm.files import readers as readers
    from gmwm.files.readers import read, stream
    from gmwm.fitting import estimation as estimation
    from gmwm.fitting import inference as inference
    from gmwm.fitting import likelihood as likelihood
    from gmwm.fitting.estimation import Fit, fit
    from gmwm.fitting.inference import plan
    from gmwm.fitting.likelihood import fit_ml
    from gmwm.measuring import covariance as covariance
    from gmwm.measuring import inspection as inspection
    from gmwm.measuring import outliers as outliers
    from gmwm.measuring import regression as regression
    from gmwm.measuring import spectrum as spectrum
    from gmwm.measuring import streaming as streaming
    from gmwm.measuring import variance as variance
    from gmwm.measuring.inspection import inspect
    from gmwm.measuring.outliers import contamination
    from gmwm.measuring.spectrum import psd
    from gmwm.measuring.variance import (
        WaveletAccumulator,
        WaveletVariance,
        allan_variance,
        avlr,
        hadamard_variance,
        total_variance,
        wavelet_variance,
    )
    from gmwm.recording import options as options
    from gmwm.recording import signals as signals
    from gmwm.recording.signals import Imu, Signal
    from gmwm.showing import exporters as exporters
    from gmwm.showing import plots as plots
    from gmwm.showing import reports as reports
    from gmwm.showing.plots import compare
    from gmwm.theory import continuous_statespace as continuous_statespace
    from gmwm.theory import filters as filters
    from gmwm.theory import processes as processes
    from gmwm.theory import simulation as simulation
    from gmwm.theory import statespace as statespace
    from gmwm.theory.processes import (
        AR,
        AR1,
        ARMA,
        DR,
        FGN,
        FN,
        GM,
        MA,
        MAT,
        OSC,
        PL,
        QN,
        RW,
        SARMA,
        SIN,
        WN,
        Model,
        fixed,
    )
    from gmwm.theory.simulation import simulate, simulate_signal

__version__ = "0.1.0"

__all__ = [
    "AR", "AR1", "ARMA", "DR", "FGN", "FN", "GM", "MA", "MAT", "OSC", "PL", "QN", "RW", "SARMA", "SIN", "WN",
    "Calibration", "Fit", "GmwmError", "Imu", "Model", "Monitor", "Signal", "WaveletAccumulator", "WaveletVariance",
    "agree", "allan_variance", "avlr", "calibrate", "compare", "contamination", "cross", "fit", "fit_joint", "fit_ml",
    "fixed", "fleet", "fuse", "hadamard_variance", "inspect", "plan", "psd", "rank", "read", "same", "select",
    "simulate", "simulate_signal", "stream", "total_variance", "wavelet_variance",
]  # fmt: skip

_NAMES = {
    "calibration": ("Calibration", "agree", "calibrate"),
    "errors": ("GmwmError",),
    "estimation": ("Fit", "fit"),
    "fleets": ("fleet",),
    "inference": ("plan",),
    "inspection": ("inspect",),
    "likelihood": ("fit_ml",),
    "monitor": ("Monitor",),
    "outliers": ("contamination",),
    "plots": ("compare",),
    "readers": ("read", "stream"),
    "selection": ("rank", "select"),
    "several": ("cross", "fit_joint", "fuse", "same"),
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

_ROOMS = {
    "applications": ("app", "fleets", "monitor", "navigation", "several"),
    "base": ("errors", "remarks", "time_base", "units"),
    "choosing": ("datasheets", "replicates", "selection"),
    "files": ("importers", "readers"),
    "fitting": ("estimation", "inference", "likelihood"),
    "measuring": ("covariance", "inspection", "outliers", "regression", "spectrum", "streaming", "variance"),
    "recording": ("options", "signals"),
    "showing": ("exporters", "plots", "reports"),
    "theory": ("continuous_statespace", "filters", "processes", "simulation", "statespace"),
}
"""Public packages by room. Programs use the short name, `gmwm.covariance`, so that a room can be rearranged."""
_PACKAGES = {name: f"gmwm.{room}.{name}" for room, names in _ROOMS.items() for name in names}


class _ShortNames:
    """Finder and loader of public packages by their short names: `gmwm.covariance` is `gmwm.covariance`."""

    @classmethod
    def find_spec(cls, name: str, path: object = None, target: object = None) -> ModuleSpec | None:
        package, _, short = name.partition(".")
        first, _, inner = short.partition(".")
        if package != __name__ or first not in _PACKAGES:
            return None
        if inner:  # a second copy of a module would be loaded
            raise ModuleNotFoundError(f"No module named {name!r}; it is {_PACKAGES[first]}.{inner}", name=name)
        loader: Any = cls()  # importlib.abc.Loader costs 12 ms to import
        return ModuleSpec(name, loader, origin=_PACKAGES[first])

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        module = import_module(str(spec.origin))
        spec.loader_state = module.__spec__
        return module

    def exec_module(self, module: ModuleType) -> None:
        """Restore the specification that the import system has replaced."""
        short, module.__spec__ = module.__spec__, None
        if short is not None:
            module.__spec__ = short.loader_state


sys.meta_path.insert(0, _ShortNames)
_IMPORTED = {"Any", "ModuleSpec", "ModuleType", "TYPE_CHECKING", "import_module", "sys"}

if not TYPE_CHECKING:

    def __getattr__(name: str) -> Any:
        """Import a name of `__all__`, a package or a room."""
        if name in __all__:
            package = next((package for package, names in _NAMES.items() if name in names), "processes")
            value = globals()[name] = getattr(import_module(f"gmwm.{package}"), name)
            return value
        if not name.startswith("_"):
            try:
                return import_module(f"gmwm.{name}")
            except ModuleNotFoundError as error:
                if error.name != f"gmwm.{name}":
                    raise
        raise AttributeError(f"module 'gmwm' has no attribute {name!r}")

    def __dir__() -> list[str]:
        return sorted({*globals(), *__all__} - _IMPORTED)
