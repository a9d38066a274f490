"""The method `plot` of results. Upper rooms and other packages register the functions that draw them."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from pkgutil import resolve_name
from types import MethodType
from typing import TYPE_CHECKING, Any

from gmwm.base.errors import OptionError
from gmwm.base.extras import admit_guests

if TYPE_CHECKING:
    from matplotlib.figure import Figure as MatplotlibFigure

GROUP = "gmwm.plots"
"""The package that registers the functions of gmwm, and the group of the entry points of other packages."""
_functions: dict[str, str | Callable[..., MatplotlibFigure]] = {}
"""Functions by the full name of the type that they draw. Those named by a text are imported when they are used.

`functools.singledispatch` would import every type and every plot to draw one."""


def register(kind: type | str, function: Callable[..., MatplotlibFigure] | str) -> None:
    """Register the function that draws objects of a type and of its subclasses.

    `result.plot()` and `gmwm.plots.plot(result)` call it with the object as the first argument. An entry point of the
    group `gmwm.plots` registers a function without a call: its name is the name of the type, its value the function.

    Parameters
    ----------
    kind : type or str
        The type, or its full name such as "package.module.Histogram".
    function : callable or str
        The function, or its full name such as "package.module:plot_histogram", which is imported when it is used.

    Examples
    --------
    >>> class Histogram(Plotted):
    ...     counts = (2, 5, 1)
    >>> def plot_histogram(histogram, *, color="black"):
    ...     return f"{len(histogram.counts)} bars in {color}"
    >>> register(Histogram, plot_histogram)
    >>> Histogram().plot(color="red")
    '3 bars in red'
    """
    _functions[kind if isinstance(kind, str) else f"{kind.__module__}.{kind.__qualname__}"] = function


def _function(kind: type) -> Callable[..., MatplotlibFigure] | None:
    import_module(GROUP)
    admit_guests(GROUP, register)
    for base in kind.__mro__:
        name = f"{base.__module__}.{base.__qualname__}"
        function = _functions.get(name)
        if isinstance(function, str):
            function = _functions[name] = resolve_name(function)
        if function is not None:
            return function
    return None


def plot(result: object, *arguments: Any, **options: Any) -> MatplotlibFigure:
    """Draw a result with the function that is registered for its type, like `result.plot()`.

    Parameters
    ----------
    result : object
        A result of gmwm, or an object of a type that another package has registered.
    *arguments, **options
        Options of the plot. `help(result.plot)` lists them; most plots have `units` and `path`.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    OptionError
        If no function is registered for the type of the result, or if an option is unknown.

    Examples
    --------
    >>> from gmwm import Signal
    >>> plot(Signal([1.0, 2.0, 4.0], 100.0, "rad/s", "gyro_x"), units="datasheet").axes[0].get_title()
    'Gyroscope X'
    """
    function = _function(type(result))
    if function is None:
        raise OptionError(
            argument="result", expected="of a type that has a plot", got=result,
            advice="Register a function for this type with gmwm.plots.register.",
        )  # fmt: skip
    return function(result, *arguments, **options)


class _Method:
    """Descriptor of the method `plot`: the registered function with its own options and documentation."""

    def __get__(self, result: object, kind: type) -> Callable[..., MatplotlibFigure]:
        function = _function(kind)
        if function is None:
            raise AttributeError(f"no function that draws {kind.__name__} is registered in {GROUP}")
        return function if result is None else MethodType(function, result)


class Plotted:
    """Base of results that have a method `plot`."""

    plot = _Method()
