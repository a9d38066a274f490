"""Plots of results with Matplotlib.

Each plot has two functions. The first returns a description of the plot without Matplotlib, as a `Panel` or `Figure`
of `gmwm.plots.figure` (for example `fit_panel` or `imu_figure`). The second (`plot_…`) draws this description with
Matplotlib. Matplotlib is imported when the first plot is drawn. Results have a method `plot`, which calls the function
for their type.

The functions `plot_…` return a `matplotlib.figure.Figure` that is not registered with pyplot, so it need not be closed,
and notebooks display it. If `path` is given, they also write the picture to a .png, .pdf or .svg file.
"""

from gmwm.showing.plots.allan import plot_allan, plot_allan_axes, plot_avlr
from gmwm.showing.plots.autocorrelation import plot_autocorrelation
from gmwm.showing.plots.coefficients import plot_coefficients
from gmwm.showing.plots.comparison import compare
from gmwm.showing.plots.fit import plot_fit
from gmwm.showing.plots.imu import plot_imu
from gmwm.showing.plots.overlay import plot_comparison
from gmwm.showing.plots.plan import plot_plan
from gmwm.showing.plots.ranking import plot_candidates, plot_ranking
from gmwm.showing.plots.residuals import plot_residuals
from gmwm.showing.plots.series import plot_components, plot_recording, plot_signal
from gmwm.showing.plots.spectrum import plot_spectra, plot_spectrum
from gmwm.showing.plots.tracks import plot_tracks
from gmwm.showing.plots.variance import plot_wavelet_variance

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
