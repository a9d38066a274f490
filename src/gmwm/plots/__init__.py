"""Plots of results with Matplotlib.

Each plot has two functions: one returns the plot as data (`wavelet_variance_panel`, `fit_panel`, `overlay_panel`,
`imu_figure`, `ranking_figure`), and one draws these data with Matplotlib (`plot_…`). Matplotlib is imported
by the first drawing. Results have a method `plot`, which calls the function of their kind.

All of them return a `matplotlib.figure.Figure` that is not registered with pyplot: it need not be closed, and notebooks
display it. With `path`, they also write the picture to a file: .png, .pdf or .svg.
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
