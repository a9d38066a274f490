"""Base classes of results: their plots, their tables for other libraries, and tests whether parts differ."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pkgutil import resolve_name
from types import MethodType
from typing import TYPE_CHECKING, Any, ClassVar

from gmwm.base.errors import OptionError
from gmwm.base.extras import admit_guests
from gmwm.base.text import Summarised

if TYPE_CHECKING:
    from matplotlib.figure import Figure as MatplotlibFigure
    from polars import DataFrame


GROUP = "gmwm.plots"
"""The package that registers the functions of gmwm, and the group of the entry points of other packages."""
_functions: dict[str, str | Callable[..., MatplotlibFigure]] = {}
"""Functions by the type that they draw, or their names: `functools.singledispatch` would import every type and plot."""


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


class Tabular(ABC):
    """Base of results and recordings that are tables."""

    coordinates: ClassVar[tuple[str, ...]] = ()
    """Columns that identify a row, which are the coordinates of a data set of xarray; without any, the row number."""

    @abstractmethod
    def to_polars(self) -> DataFrame:
        """Return the table as a data frame of Polars."""

    def to_pandas(self, *arguments: Any, **options: Any) -> Any:
        """Return the table as a data frame of pandas. The arguments are those of `to_polars`."""
        import pandas

        frame = self.to_polars(*arguments, **options)
        return pandas.DataFrame({column.name: column.to_numpy() for column in frame.get_columns()})

    def to_xarray(self, *arguments: Any, **options: Any) -> Any:
        """Return the table as a data set of xarray. The arguments are those of `to_polars`."""
        frame = self.to_pandas(*arguments, **options)
        return (frame.set_index(list(self.coordinates)) if self.coordinates else frame).to_xarray()


@dataclass(frozen=True, kw_only=True)
class Difference:
    """Ratio of one part (`name`, such as "gyro_x at 0.02 s, monday") to the others, with confidence limits and `pvalue`
    adjusted for the number of tests, each None if unknown; `differs`: significant."""

    name: str
    ratio: float
    lower: float | None = None
    upper: float | None = None
    pvalue: float | None = None
    differs: bool = False


class DifferenceTests(Summarised, Plotted):
    """Base of results that answer whether parts differ: recordings, calibrations, units of a fleet, or conditions."""

    @property
    @abstractmethod
    def tests(self) -> tuple[Difference, ...]:
        """All comparisons in one form, for plots and for programs that handle every kind of comparison."""
