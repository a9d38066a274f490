"""Plots of results with Matplotlib. `result.plot()` calls the function registered for the result's type.

A function with the decorator `drawing` returns a description, a `Figure` of `gmwm.showing.plots.figure`, which
Matplotlib, imported at the first plot, draws; `description(plot)` returns the function itself. Parts, such as
`fit_panel`, return a `Panel`. Figures are not registered with pyplot: notebooks display them, and none is closed."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from gmwm.base.results import Plotted as Plotted
from gmwm.base.results import plot, register

if TYPE_CHECKING:
    from gmwm.showing.plots.allan import plot_allan, plot_allan_axes, plot_avlr
    from gmwm.showing.plots.curves import compare, plot_comparison, plot_wavelet_variance
    from gmwm.showing.plots.fit import plot_fit
    from gmwm.showing.plots.imu import plot_imu
    from gmwm.showing.plots.likelihood import plot_autocorrelation, plot_residuals, plot_tracks
    from gmwm.showing.plots.ranking import plot_candidates, plot_ranking
    from gmwm.showing.plots.results import plot_plan
    from gmwm.showing.plots.series import plot_coefficients, plot_components, plot_recording, plot_signal
    from gmwm.showing.plots.spectrum import plot_spectra, plot_spectrum

__all__ = [
    "Plotted", "compare", "plot", "plot_allan", "plot_allan_axes", "plot_autocorrelation", "plot_avlr",
    "plot_candidates", "plot_coefficients", "plot_comparison", "plot_components", "plot_fit", "plot_imu", "plot_plan",
    "plot_ranking", "plot_recording", "plot_residuals", "plot_signal", "plot_spectra", "plot_spectrum", "plot_tracks",
    "plot_wavelet_variance", "register",
]  # fmt: skip

_RESULTS = {
    "base.results.DifferenceTests": "results.plot_differences",
    "calibration.result.Calibration": "imu.plot_imu",
    "choosing.replicates.result.Replicates": "curves.plot_recordings",
    "choosing.selection.ranking.Comparison": "ranking.plot_candidates",
    "choosing.selection.ranking.Ranking": "ranking.plot_ranking",
    "fitting.estimation.conditions_fit.ConditionsFit": "curves.plot_conditions",
    "fitting.estimation.result.Fit": "fit.plot_fit", "fitting.inference.planning.Plan": "results.plot_plan",
    "fitting.likelihood.innovations.Residuals": "likelihood.plot_residuals",
    "fitting.likelihood.result.LikelihoodFit": "fit.plot_fit",
    "fitting.likelihood.tracks.Tracks": "likelihood.plot_tracks",
    "measuring.regression.result.Regression": "results.plot_regression",
    "measuring.spectrum.result.PowerSpectra": "spectrum.plot_spectra",
    "measuring.spectrum.result.PowerSpectrum": "spectrum.plot_spectrum",
    "measuring.variance.allan_regression.AllanRegression": "allan.plot_avlr",
    "measuring.variance.result.WaveletVariances": "imu.plot_imu",
    "measuring.axis_results.ResultsByAxis": "imu.plot_results",
    "measuring.variance.clusters.ClusterVariance": "allan.plot_allan",
    "measuring.variance.result.WaveletVariance": "curves.plot_wavelet_variance",
    "recording.signals.Imu": "series.plot_recording", "recording.signals.Signal": "series.plot_signal",
    "theory.simulation.api.SimulatedSignal": "series.plot_components",
}  # fmt: skip
"""Functions of this package by the result that they draw."""
_OTHERS = ("allan.plot_allan_axes", "likelihood.plot_autocorrelation", "series.plot_coefficients",
           "curves.compare", "curves.plot_comparison")  # fmt: skip
"""Functions that draw several results, or with other arguments than `result.plot()`."""
_MODULES = {name: module for module, _, name in (place.partition(".") for place in (*_RESULTS.values(), *_OTHERS))}

for _kind, _place in _RESULTS.items():
    register(f"gmwm.{_kind}", f"{__name__}.{_place}")

if not TYPE_CHECKING:

    def __getattr__(name: str) -> Any:
        """Import a function when it is used: all modules of this package import most of gmwm, which takes 0.4 s."""
        if name not in _MODULES:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        function = globals()[name] = getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
        return function
