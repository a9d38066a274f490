"""A newcomer's process: parameters and one piece of theory, all the rest follows."""

from dataclasses import dataclass
from types import new_class

import numpy as np
import pytest

from gmwm.base.errors import MissingTheoryError, ModelError
from gmwm.theory.processes import WN, Model, Parameter, Process, registry
from gmwm.theory.processes.parameter import Value
from gmwm.theory.statespace import StateSpace
from tests.helpers import raises

THETA = Parameter("theta", "θ", "moving average coefficient", domain="real")
SIGMA2 = Parameter("sigma2", "σ²", "innovation variance", signal_power=2, scale_power=1)


class _MovingAverage(Process, abstract=True):
    name = "MA1"
    title = "First-order moving average"
    parameters = (THETA, SIGMA2)


@dataclass(frozen=True, repr=False)
class FromAutocovariance(_MovingAverage, register=False):
    theta: Value = None
    sigma2: Value = None

    def autocovariance(self, lags, rate):
        k, theta = np.abs(np.asarray(lags)), self.value("theta")
        return self.scale * np.where(k == 0, 1 + theta**2, np.where(k == 1, theta, 0.0))


@dataclass(frozen=True, repr=False)
class FromStateSpace(_MovingAverage, register=False):
    theta: Value = None
    sigma2: Value = None

    def state_space(self, rate):
        v, theta = self.scale, self.value("theta")
        q = np.array([[v, 0.0], [0.0, 0.0]])
        return StateSpace([[0, 0], [1, 0]], q, [1.0, theta], P0=v * np.eye(2))


@dataclass(frozen=True, repr=False)
class FromRunningSum(_MovingAverage, register=False):
    theta: Value = None
    sigma2: Value = None

    def running_sum_covariance(self, lags, rate):
        # Var(sum of m) = σ²(m(1+θ)² − 2θ) for m ≥ 1.
        m, theta = np.abs(np.asarray(lags)), self.value("theta")
        return -0.5 * self.scale * np.where(m == 0, 0.0, m * (1 + theta) ** 2 - 2 * theta)


@dataclass(frozen=True, repr=False)
class Impossible(_MovingAverage, register=False):
    """An "autocovariance" that is larger at lag 1 than at lag 0."""

    parameters = (SIGMA2,)
    sigma2: Value = None

    def autocovariance(self, lags, rate):
        k = np.abs(np.asarray(lags))
        return self.scale * np.where(k == 0, 1.0, np.where(k == 1, 2.0, 0.0))


WAYS = [FromAutocovariance, FromStateSpace, FromRunningSum]


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("theta", [-0.9, 0.0, 0.6])
def test_wavelet_variance_and_jacobian_follow_from_one_piece_of_theory(way, theta):
    tau = 2.0 ** np.arange(1, 13)
    one = way(theta=theta, sigma2=3.0)
    np.testing.assert_allclose(
        one.wavelet_variance(12, 1.0), 3.0 * ((1 + theta) ** 2 * tau - 6 * theta) / tau**2, rtol=1e-9
    )
    jacobian = (one + WN(sigma2=1.0)).jacobian(12, 1.0)
    np.testing.assert_allclose(jacobian[:, 0], 3.0 * (2 * (1 + theta) * tau - 6) / tau**2, rtol=1e-7, atol=1e-9)
    assert one.search(1000, 1.0) == ()


def test_a_sum_that_would_take_too_long_is_refused():
    with raises(MissingTheoryError, "MA1", advises=("running_sum_covariance", "state_space", "FromAutocovariance")):
        FromAutocovariance(theta=0.5, sigma2=1.0).wavelet_variance([30], 1.0)


def test_what_cannot_be_derived_is_missing():
    assert not FromAutocovariance.has("state_space")
    with raises(MissingTheoryError, process="MA1", theory="state_space", advises=("autocovariance", "simulate")):
        FromAutocovariance(theta=0.5, sigma2=1.0).state_space(1.0)
    with raises(MissingTheoryError, process="MA1", theory="simulate"):
        FromRunningSum(theta=0.5, sigma2=1.0).simulate(3, 1.0, 1)


@pytest.mark.parametrize("way", [FromAutocovariance, FromStateSpace])
def test_paths_follow_from_either_theory(way):
    one = way(theta=0.5, sigma2=2.0)
    paths = one.simulate(50, 1.0, rng=1, paths=4000)
    np.testing.assert_array_equal(paths[:2], one.simulate(50, 1.0, rng=1, paths=4000)[:2])
    products = [paths[:, 20] * paths[:, 20 + lag] for lag in range(4)]
    for product, expected in zip(products, one.autocovariance(np.arange(4), 1.0), strict=True):
        assert abs(product.mean() - expected) < 4 * product.std() / np.sqrt(4000)


@pytest.mark.slow
def test_what_is_no_autocovariance_cannot_be_simulated():
    with raises(MissingTheoryError, 2**22, largest=2**22):
        Impossible(sigma2=1.0).simulate(100, 1.0, 1)


def test_an_incomplete_definition_is_refused_when_it_is_written():
    with raises(ModelError, "Empty", "running_sum_covariance", "state_space", "autocovariance", argument="shape"):
        type("Empty", (_MovingAverage,), {})
    with raises(ModelError, "NoScale", "scale_power", argument="parameters"):
        type("NoScale", (FromStateSpace,), {"parameters": (THETA,)})
    with raises(ModelError, "NoTitle", argument="title"):
        type("NoTitle", (Process,), {"name": "NT"})
    assert "MA1" not in registry


@pytest.fixture
def own_registry():
    """What a test registers is gone after it."""
    before = dict(registry)
    yield registry
    registry.clear()
    registry.update(before)


def defined(name="MA9", qualname="MovingAverage", module="__main__"):
    """A class as a cell of a notebook defines it."""
    body = {"name": name, "__module__": module, "__qualname__": qualname, "theta": None, "sigma2": None}
    return new_class(
        "MovingAverage", (_MovingAverage,), {}, lambda n: n.update(body, state_space=FromStateSpace.state_space)
    )


def test_a_class_defined_anew_takes_the_place_of_the_older(own_registry):
    older, newer = defined(), defined()
    assert older is not newer
    assert registry["MA9"] is newer
    assert type(Model.parse("MA9").processes[0]) is newer


@pytest.mark.parametrize(
    "other",
    [{"module": "elsewhere"}, {"qualname": "Another"}, {"name": "ma9"}, {"module": "gmwm.theory.processes.noise"}],
)
def test_a_name_belongs_to_one_class(own_registry, other):
    older = defined()
    with raises(ModelError, "MA9", "__main__.MovingAverage", argument="name", advises=("another name",)):
        defined(**other)
    assert registry["MA9"] is older


@pytest.mark.parametrize("name", ["WN", "wn"])
def test_no_class_takes_the_place_of_a_built_in_one(own_registry, name):
    with raises(ModelError, "gmwm.theory.processes.noise.WN, a process of gmwm", argument="name", got=name):
        type("WN", (WN,), {"name": name, "__module__": WN.__module__, "__qualname__": WN.__qualname__})
    assert registry["WN"] is WN


METHODS = {
    "an instance's shape": ("shape", lambda self, levels, rate: levels),
    "a shape without a filter": ("shape", classmethod(lambda cls, nonlinear, levels, rate: levels)),
    "a shape that wants more": ("shape", classmethod(lambda cls, nonlinear, levels, rate, filter, more: levels)),
    "a covariance without a rate": ("autocovariance", lambda self, lags: lags),
    "a state space of the class": ("state_space", classmethod(lambda cls, rate: rate)),
}


@pytest.mark.parametrize("what", METHODS)
def test_a_method_that_cannot_be_called_is_refused_when_it_is_written(what):
    name, method = METHODS[what]
    written = {
        "shape": "a class method, shape(cls, nonlinear, levels, rate, filter=…)",
        "autocovariance": "autocovariance(self, lags, rate)",
        "state_space": "state_space(self, rate)",
    }
    with raises(ModelError, f"Wrong.{name}", written[name], argument=name):
        type("Wrong", (FromStateSpace,), {name: method}, register=False)


def test_other_names_and_more_arguments_with_defaults_are_fine():
    def autocovariance(self, k, rate, tail=0.0):
        return np.where(np.asarray(k) == 0, self.scale, tail)

    made = type("Fine", (FromAutocovariance,), {"autocovariance": autocovariance}, register=False)
    np.testing.assert_allclose(made(theta=0.0, sigma2=2.0).wavelet_variance(1, 1.0), 1.0, rtol=1e-12)
