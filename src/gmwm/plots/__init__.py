"""Plots of results with Matplotlib.

Each plot has two functions. The first returns a description of the plot without Matplotlib, as a `Panel` or `Figure`
of `gmwm.plots.figure` (for example `fit_panel` or `imu_figure`). The second (`plot_…`) draws this description with
Matplotlib. Matplotlib is imported when the first plot is drawn. Results have a method `plot`, which calls the function
for their type.

The functions `plot_…` return a `matplotlib.figure.Figure` that is not registered with pyplot, so it need not be closed,
and notebooks display it. If `path` is given, they also write the picture to a .png, .pdf or .svg file.
"""

from gmwm.plots.allan import plot_allan, plot_allan_axes, plot_avlr
from gmwm.plots.autocorrelation import plot_autocorrelation
from gmwm.plots.coefficients import plot_coefficients
from gmwm.plots.comparison import compare
from gmwm.plots.fit import plot_fit
from gmwm.plots.fleet import plot_fleet
from gmwm.plots.imu import plot_imu
from gmwm.plots.overlay import plot_comparison
from gmwm.plots.plan import plot_plan
from gmwm.plots.ranking import plot_candidates, plot_ranking
from gmwm.plots.residuals import plot_residuals
from gmwm.plots.series import plot_components, plot_recording, plot_signal
from gmwm.plots.spectrum import plot_spectra, plot_spectrum
from gmwm.plots.tracks import plot_tracks
from gmwm.plots.variance import plot_wavelet_variance

__all__ = [
    "compare",
    "plot_allan",
    "plot_allan_axes",
    "plot_autocorrelation",
    "plot_avlr",
    "plot_candidates",
    "plot_coefficients",
    "plot_comparison",
    "plot_components",
    "plot_fit",
    "plot_fleet",
    "plot_imu",
    "plot_plan",
    "plot_ranking",
    "plot_recording",
    "plot_residuals",
    "plot_signal",
    "plot_spectra",
    "plot_spectrum",
    "plot_tracks",
    "plot_wavelet_variance",
]
