"""Plot of one wavelet variance with its confidence band."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

from gmwm.showing.plots.curves import closed_panel, observed_marks, view_for
from gmwm.showing.plots.figure import Figure, Panel
from gmwm.showing.plots.labels import axis_title
from gmwm.showing.plots.view import UnitSystem, ViewName

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as MatplotlibFigure

    from gmwm.measuring.variance.result import WaveletVariance


def wavelet_variance_panel(wv: WaveletVariance, *, view: ViewName = "wavelet", units: UnitSystem = "si") -> Panel:
    """Return the panel that `plot_wavelet_variance` draws."""
    shown = view_for(wv, view, units)
    return closed_panel([shown], [wv], observed_marks(wv, shown), title=axis_title(wv.axis))


def plot_wavelet_variance(
    wv: WaveletVariance,
    *,
    view: ViewName = "wavelet",
    units: UnitSystem = "si",
    label: str | None = None,
    color: str | None = None,
    ax: Axes | None = None,
    path: str | os.PathLike[str] | None = None,
) -> MatplotlibFigure:
    """Draw a wavelet variance over its scales. `WaveletVariance.plot` describes the arguments."""
    from gmwm.showing.plots.matplotlib import draw
    from gmwm.showing.plots.shared_axes import named_panel

    if label is None and color is None:
        panel = wavelet_variance_panel(wv, view=view, units=units)
    else:
        panel = named_panel(wv, label=label, color=color, view=view, units=units, ax=ax)
    return draw(Figure(((panel,),), height=88.0), ax=ax, path=path)
