"""One method `plot`: every result has a registered function, and another package can register its own."""

import inspect
import sys
from importlib import metadata

import pytest

import gmwm
from gmwm.base import extras, results
from gmwm.base.results import DifferenceTests
from tests.helpers import raises
from tests.test_house import modules


class Histogram(gmwm.plots.Plotted):
    """A result of another package."""

    counts = (2, 5, 1)


class Detailed(Histogram):
    """A result without a function of its own."""


def plot_histogram(histogram, *, colour="black"):
    """Draw a histogram."""
    return f"{sum(histogram.counts)} samples in {colour}"


@pytest.fixture
def registry(monkeypatch):
    """A copy of the registry, which another package has not changed."""
    monkeypatch.setattr(results, "_functions", dict(results._functions))
    extras.admit_guests.cache_clear()
    yield
    extras.admit_guests.cache_clear()


def result_classes():
    """Classes of gmwm that inherit from `Plotted`; the bases of results are no results."""
    for name in modules():
        __import__(name)
    pending, classes = [gmwm.plots.Plotted], []
    while pending:
        pending += (children := pending.pop().__subclasses__())
        classes += children
    # The example of `register` defines a class too.
    ours = [kind for kind in classes if kind.__module__.startswith("gmwm.") and kind.__module__ != results.__name__]
    return [kind for kind in ours if not any(issubclass(other, kind) for other in ours if other is not kind)]


@pytest.mark.slow
def test_every_result_has_a_plot_and_every_registered_type_exists():
    classes = result_classes()
    assert {gmwm.Fit, gmwm.Signal, gmwm.Calibration} <= set(classes)
    for kind in classes:
        assert kind.plot.__doc__.startswith("Draw "), kind
        assert "path" in inspect.signature(kind.plot).parameters, kind
    names = {f"{kind.__module__}.{kind.__qualname__}" for kind in (*classes, DifferenceTests)}  # a base with a plot
    assert {f"gmwm.{name}" for name in gmwm.plots._RESULTS} <= names


def test_the_method_has_the_options_and_the_documentation_of_the_function():
    signal = gmwm.Signal([1.0, 2.0, 4.0], 100.0)
    assert [*inspect.signature(signal.plot).parameters] == ["units", "ax", "path"]
    assert "Draw the signal over time" in inspect.getdoc(signal.plot)
    assert inspect.getdoc(gmwm.Fit.plot) == inspect.getdoc(gmwm.plots.plot_fit)


@pytest.mark.usefixtures("registry")
def test_another_package_registers_a_function():
    assert not hasattr(Histogram(), "plot")
    gmwm.plots.register(Histogram, plot_histogram)
    assert Histogram().plot(colour="red") == gmwm.plots.plot(Histogram(), colour="red") == "8 samples in red"
    assert Detailed().plot() == "8 samples in black"


@pytest.mark.usefixtures("registry")
def test_an_entry_point_registers_a_function(monkeypatch):
    group = "gmwm.plots"
    entry = metadata.EntryPoint(f"{__name__}.Histogram", f"{__name__}:plot_histogram", group)
    monkeypatch.setattr(extras, "entry_points", lambda *, group: [entry] if group == entry.group else [])
    monkeypatch.setitem(sys.modules, __name__, inspect.getmodule(plot_histogram))
    assert Histogram().plot() == "8 samples in black"


def test_a_type_without_a_plot_is_refused():
    with raises(gmwm.errors.OptionError, argument="result"):
        gmwm.plots.plot(3.0)
