"""Plot of several wavelet variances in one panel, with labels that state how they differ."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import TYPE_CHECKING

from gmwm.base.errors import OptionError
from gmwm.showing.plots.labels import axis_title
from gmwm.showing.plots.overlay import Item, measured, plot_comparison
from gmwm.showing.plots.view import UnitSystem, ViewName

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as MatplotlibFigure

    from gmwm.measuring.variance.result import WaveletVariance


def compare(
    *items: Item,
    labels: Sequence[str] | None = None,
    view: ViewName = "wavelet",
    units: UnitSystem = "si",
    title: str = "",
    ax: Axes | None = None,
    path: str | os.PathLike[str] | None = None,
) -> MatplotlibFigure:
    """Draw several wavelet variances in one panel, for example classical and robust, or several axes or recordings.

    Parameters
    ----------
    items : WaveletVariance or Fit
        One or more curves. A fit is drawn with symbols for the data and a line for the model.
    labels : sequence of str, optional
        Names for the legend. By default, they state the properties in which the curves differ: axis, classical or
        robust estimate, filter, length and rate, or fitted model.
    view : "wavelet" or "allan"
        ν² against the scale τ (s), or the Allan deviation √(2ν²) against the averaging time τ/2 (s).
    units : "si" or "datasheet"
        rad/s and m/s², or deg/h and mg.
    title : str
        Title of the panel.
    ax : matplotlib Axes, optional
        Axes to draw on; by default a new figure is made.
    path : path, optional
        File to write the picture to, ending in .png, .pdf or .svg.

    Returns
    -------
    matplotlib.figure.Figure
        A figure that is not registered with pyplot, so it need not be closed. Notebooks display it.

    Raises
    ------
    OptionError
        If an option is unknown, a label is missing or repeated, or the curves differ in unit.

    References
    ----------
    The comparison of classical and robust wavelet variances follows Balamuta, Guerrier, Molinari and Yang.

    Examples
    --------
    >>> import numpy as np
    >>> from gmwm import Signal, wavelet_variance
    >>> signal = Signal(np.random.default_rng(1).normal(size=4096), 100.0, "rad/s", "gyro_x")
    >>> figure = compare(wavelet_variance(signal), wavelet_variance(signal, robust=True))
    >>> figure.axes[0].get_ylabel()
    'Wavelet variance (rad²/s²)'
    """
    if not items:
        raise OptionError(argument="items", expected="one or more of WaveletVariance and Fit", got=items)
    for item in items:
        if not hasattr(measured(item), "robust"):
            raise OptionError(
                argument="items",
                expected="of type WaveletVariance or Fit",
                got=item,
                advice="Draw Allan variances with `gmwm.plots.plot_allan_axes`.",
            )
    names = automatic_labels(items) if labels is None else [str(name) for name in labels]
    if len(names) != len(items):
        raise OptionError(
            argument="labels", expected=f"a sequence of {len(items)} names, one for each curve", got=names
        )
    if len(set(names)) != len(names):
        raise OptionError(argument="labels", expected="a sequence of different names", got=names)
    return plot_comparison(dict(zip(names, items, strict=True)), view=view, units=units, title=title, ax=ax, path=path)


def automatic_labels(items: Sequence[Item]) -> list[str]:
    """Return a name for each item that states how it differs from the others, such as by its axis or its model.

    Items that do not differ are numbered.

    >>> from gmwm.measuring.variance.result import WaveletVariance
    >>> one = WaveletVariance.from_values([2.0, 1.0], samples=1000, rate=100.0, axis="gyro_x")
    >>> two = WaveletVariance.from_values([2.0, 1.0], samples=1000, rate=100.0, axis="gyro_x", robust=True)
    >>> automatic_labels([one, two]), automatic_labels([one, one])
    (['classical', 'robust'], ['Gyroscope X (1)', 'Gyroscope X (2)'])
    """
    results = [measured(item) for item in items]
    aspects = [
        [axis_title(wv.axis) for wv in results],
        _estimators(results),
        [f"{wv.filter} {wv.transform.upper()}" for wv in results],
        [wv.extent for wv in results],
        [_model(item) for item in items],
    ]
    telling = [aspect for aspect in aspects if len(set(aspect)) > 1] or [aspects[0]]
    names = [", ".join(filter(None, words)) or "Wavelet variance" for words in zip(*telling, strict=True)]
    for name in {name for name in names if names.count(name) > 1}:
        same = [k for k, other in enumerate(names) if other == name]
        for number, k in enumerate(same, 1):
            names[k] = f"{name} ({number})"
    return names


def _model(item: Item) -> str:
    """Return the structure of a fitted model, for example "2*GM + WN"; "" for a measured curve."""
    model = getattr(item, "model", None)
    return "" if model is None else str(model.structure)


def _estimators(results: Sequence[WaveletVariance]) -> list[str]:
    """Return "classical" or "robust" for each result, with the efficiency if it differs between robust results."""
    several = len({wv.efficiency for wv in results if wv.robust}) > 1
    return [
        (f"robust, efficiency {wv.efficiency:g}" if several else "robust") if wv.robust else "classical"
        for wv in results
    ]
