"""Plot of one wavelet variance with its confidence band."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

from gmwm.showing.plots.curves import closed_panel, observed_marks, view_for
from gmwm.showing.plots.drawing import drawing
from gmwm.showing.plots.figure import Figure, Panel
from gmwm.showing.plots.labels import axis_title
from gmwm.showing.plots.view import UnitSystem, ViewName

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from gmwm.measuring.variance.result import WaveletVariance


def wavelet_variance_panel(wv: WaveletVariance, *, view: ViewName = "wavelet", units: UnitSystem = "si") -> Panel:
    """Return the panel that `plot_wavelet_variance` draws."""
    shown = view_for(wv, view, units)
    return closed_panel([shown], [wv], observed_marks(wv, shown), title=axis_title(wv.axis))


@drawing
def plot_wavelet_variance(
    wv: WaveletVariance,
    *,
    view: ViewName = "wavelet",
    units: UnitSystem = "si",
    label: str | None = None,
    color: str | None = None,
    ax: Axes | None = None,
    path: str | os.PathLike[str] | None = None,
) -> Figure:
    """Draw the wavelet variance over the scale, with its confidence band, on logarithmic axes.

    Levels with a variance of zero are marked at the lower edge of the plot.

    Parameters
    ----------
    label : str, optional
        Name of the curve in the legend. Use it to draw several curves on the same axes, as in
        `monday.plot(ax=ax, label="monday")`. Each curve then has its own colour and symbol.
    color : str, optional
        Matplotlib colour such as "#D55E00"; by default a colour that no earlier curve has.

    Raises
    ------
    OptionError
        If an option is unknown, if the data do not support it, or if an earlier curve on `ax` has another unit.

    Examples
    --------
    >>> from gmwm import WaveletVariance
    >>> wv = WaveletVariance.from_values([4e-6, 2e-6, 1e-6], samples=1000, rate=100.0, unit="rad/s")
    >>> figure = wv.plot(view="allan", units="datasheet")
    >>> figure.axes[0].get_ylabel()
    'Allan deviation (deg/h)'
    """
    from gmwm.showing.plots.shared_axes import named_panel

    if label is None and color is None:
        panel = wavelet_variance_panel(wv, view=view, units=units)
    else:
        panel = named_panel(wv, label=label, color=color, view=view, units=units, ax=ax)
    return Figure(((panel,),), height=88.0)
