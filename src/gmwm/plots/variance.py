"""The curve of one wavelet variance, with its confidence band."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

from gmwm.plots.curves import closed_panel, observed_marks, view_for
from gmwm.plots.figure import Figure, Panel
from gmwm.plots.labels import axis_title
from gmwm.plots.view import UnitSystem, ViewName

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as MatplotlibFigure

    from gmwm.variance.result import WaveletVariance


def wavelet_variance_panel(wv: WaveletVariance, *, view: ViewName = "wavelet", units: UnitSystem = "si") -> Panel:
    """What `plot_wavelet_variance` draws, as data."""
    shown = view_for(wv, view, units)
    return closed_panel([shown], [wv], observed_marks(wv, shown), title=axis_title(wv.axis))


def plot_wavelet_variance(
    wv: WaveletVariance,
    *,
    view: ViewName = "wavelet",
    units: UnitSystem = "si",
    ax: Axes | None = None,
    path: str | os.PathLike[str] | None = None,
) -> MatplotlibFigure:
    """Draw a wavelet variance over its scales, with the confidence band, on logarithmic axes.

    Parameters
    ----------
    wv : WaveletVariance
        What was measured; levels with variance zero are marked at the foot of the axis.
    view : "wavelet" or "allan"
        ν² over the scale τ (s), or the Allan deviation √(2ν²) over the averaging time τ/2 (s).
    units : "si" or "datasheet"
        rad/s and m/s², or deg/h and mg.
    ax : matplotlib Axes, optional
        Where to draw; a new figure by default.
    path : path, optional
        Write the picture there too, as .png, .pdf or .svg.

    Returns
    -------
    matplotlib.figure.Figure
        Shows itself in a notebook; not known to pyplot, so nothing has to be closed.

    Raises
    ------
    OptionError
        If an option is unknown or cannot be had for these data.

    >>> from gmwm.variance.result import WaveletVariance
    >>> wv = WaveletVariance.from_values([4e-6, 2e-6, 1e-6], samples=1000, rate=100.0, unit="rad/s")
    >>> figure = plot_wavelet_variance(wv, view="allan", units="datasheet")
    >>> figure.axes[0].get_ylabel()
    'Allan deviation (deg/h)'
    """
    from gmwm.plots.matplotlib import draw

    panel = wavelet_variance_panel(wv, view=view, units=units)
    return draw(Figure(((panel,),), height=88.0), ax=ax, path=path)
