"""Decorator of functions that draw a result. It draws the figure that they describe, and documents common options."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable
from functools import wraps
from typing import TYPE_CHECKING, Any, ParamSpec

from gmwm.base.extras import library

if TYPE_CHECKING:
    from matplotlib.figure import Figure as MatplotlibFigure

    from gmwm.showing.plots.figure import Figure

P = ParamSpec("P")

_OPTIONS = {
    "view": """view : "auto", "allan" or "wavelet"
    Quantity to draw: the Allan deviation √(2ν²) against the averaging time τ/2 (s), or the wavelet variance ν² against
    the scale τ (s). By default the Allan deviation, if the filter is Haar's.""",
    "units": """units : "auto", "datasheet" or "si"
    Units of the plot: deg/h and mg, or rad/s and m/s². By default, Allan deviations are in datasheet units, and
    everything else is in SI units. Data in other units are not converted.""",
    "ax": """ax : matplotlib Axes, optional
    Axes to draw on; by default the axes of a new figure.""",
    "path": """path : path, optional
    File to write the picture to, ending in .png, .pdf or .svg.""",
}
"""Documentation of the options that plots share."""
_SECTIONS = {
    "Parameters": "Parameters\n----------",
    "Returns": """Returns
-------
matplotlib.figure.Figure
    A figure that is not registered with pyplot, so it need not be closed. Notebooks display it.""",
    "Raises": """Raises
------
OptionError
    If an option is unknown, or the data do not support it.""",
}
"""Sections that the documentation of each plot has, and their content if the function does not document them."""


def drawing(describe: Callable[P, Figure]) -> Callable[P, MatplotlibFigure]:
    """Draw the figure that a function describes, with its options `ax` and `path`, and complete its docstring."""

    @wraps(describe)
    def plot(*arguments: P.args, **options: P.kwargs) -> MatplotlibFigure:
        library("matplotlib")
        from gmwm.showing.plots.axes import one_tick_form
        from gmwm.showing.plots.matplotlib import draw

        places: dict[str, Any] = {name: options.get(name) for name in ("ax", "path")}
        return draw(one_tick_form(describe(*arguments, **options)), **places)

    plot.__doc__ = _documentation(inspect.getdoc(describe) or "", [*inspect.signature(describe).parameters])
    return plot


def _documentation(text: str, names: list[str]) -> str:
    """Return a docstring with the options that plots share, and with all sections of `_SECTIONS`."""
    head, *written = re.split(r"\n\n(?=\w+\n---)", text)
    sections = _SECTIONS | {section.partition("\n")[0]: section for section in written}
    specific = sections["Parameters"]
    common = [words for name, words in _OPTIONS.items() if name in names and f"\n{name} : " not in specific]
    sections["Parameters"] = "\n".join([specific, *common])
    return "\n\n".join([head, *sections.values()]) + "\n"
