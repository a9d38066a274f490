"""What a process is: parameters, a shape, and the little theory from which the rest follows.

Every process is (one linear scale coefficient) × (a shape that depends on its nonlinear parameters).
A subclass gives what it has in closed form; the defaults here derive the rest. Each subclass enters the
registry by itself, which the parser, the command line, the documentation and the law tests go by.
"""

from __future__ import annotations

import math
from abc import ABC
from collections.abc import Iterable
from dataclasses import replace
from inspect import isfunction, ismethod, signature
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gmwm._arrays import Matrix, Vector, as_levels, as_rate
from gmwm._text import defined_anew, is_own
from gmwm.continuous_statespace import ContinuousStateSpace
from gmwm.errors import MissingTheoryError, ModelError, OptionError
from gmwm.filters import HAAR, WaveletFilter, find_filter
from gmwm.processes import circulant_embedding, filtered
from gmwm.processes.haar_covariance import LagGrid
from gmwm.processes.parameter import Branch, Fixed, Parameter, Value
from gmwm.processes.physical import Physical
from gmwm.processes.start_context import Occasion
from gmwm.processes.validation import as_clusters, as_frequencies, as_lags, as_paths, as_rng, shape_of_paths
from gmwm.remarks import Remark
from gmwm.statespace import StateSpace, haar_variances

if TYPE_CHECKING:
    from gmwm.processes.model import Model

registry: dict[str, type[Process]] = {}
"""Every process by name, in the order in which they are shown."""

Theory = Literal[
    "wavelet_variance",
    "running_sum_covariance",
    "autocovariance",
    "psd",
    "state_space",
    "simulate",
    "coefficient_covariance",
    "generalised_covariance",
    "allan_variance",
]

# What each piece of theory can be derived from; the first that the process has is taken.
_SOURCES: dict[str, tuple[str, ...]] = {
    "wavelet_variance": ("running_sum_covariance", "state_space", "autocovariance"),
    "running_sum_covariance": ("state_space", "autocovariance"),
    "autocovariance": ("state_space",),
    "psd": ("state_space",),
    "simulate": ("state_space", "autocovariance"),
    "state_space": (),
    "coefficient_covariance": (),
    "generalised_covariance": ("autocovariance", "running_sum_covariance"),
    "allan_variance": ("running_sum_covariance",),
}
_NEEDS_STATIONARITY = frozenset({"running_sum_covariance", "autocovariance", "psd"})
_LONGEST_SUM = 2**24


class Process(ABC):
    """One latent noise process. Concrete ones are frozen dataclasses whose fields are the parameters.

    Theory is per sample and in SI, u being the unit of the signal. Methods take the same throughout: `rate` in Hz;
    `levels`, the number J of them or a list; `lags` (samples); `frequencies` (Hz); `clusters`, their sizes (samples);
    `filter`, of `find_filter`; `samples`, the length N of a record; `nonlinear`, an (n, q) array with a row of q
    parameters of the shape for each of n processes; `n` and `paths`, how many samples and paths; `rng`, a NumPy
    Generator or a seed. Theory that a process has not raises `MissingTheoryError`; `has` asks for it.
    """

    name: ClassVar[str]
    """Short name, as written in a model: "GM"."""
    title: ClassVar[str]
    """Full name: "Gauss-Markov process"."""
    parameters: ClassVar[tuple[Parameter, ...]]
    """Its parameters, in the order of the fields."""
    repeatable: ClassVar[bool] = False
    """Whether a sum can hold several: only where their shapes can differ."""
    stationary: ClassVar[bool] = True
    """Whether it has an autocovariance."""
    parametrises: ClassVar[str | None] = None
    """Name of the process that several classes parametrise; a model may use one of these classes only."""

    def __init_subclass__(cls, *, register: bool = True, abstract: bool = False, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        if abstract:
            return
        if missing := [name for name in ("name", "title", "parameters") if not hasattr(cls, name)]:
            raise ModelError(
                f"{cls.__name__} must define name, title and parameters; {missing[0]} is missing", argument=missing[0]
            )
        if sum(p.scale_power is not None for p in cls.parameters) != 1:
            raise ModelError(
                f"{cls.__name__}.parameters must have exactly one parameter with a scale_power", argument="parameters"
            )
        if not cls.has("wavelet_variance"):
            sources = ", ".join(_SOURCES["wavelet_variance"])
            raise ModelError(f"{cls.__name__} must define at least one of shape, {sources}", argument="shape")
        _check_calls(cls)
        if register:
            _check_name(cls)
            registry[cls.name] = cls

    def __post_init__(self) -> None:
        for parameter in self.parameters:
            value = parameter.checked(getattr(self, parameter.name), self.name)
            object.__setattr__(self, parameter.name, value)

    # --- values ---------------------------------------------------------------------------------------

    @property
    def values(self) -> dict[str, float | None]:
        """Value of each parameter, held or not; None where it is to be estimated."""
        given = {p.name: getattr(self, p.name) for p in self.parameters}
        return {name: v.value if isinstance(v, Fixed) else v for name, v in given.items()}

    def is_fixed(self, name: str) -> bool:
        """Whether the parameter `name` is held."""
        return isinstance(getattr(self, name), Fixed)

    @property
    def is_complete(self) -> bool:
        """Whether every parameter has a value."""
        return None not in self.values.values()

    def value(self, name: str) -> float:
        """Value of the parameter `name`; ModelError where it has none."""
        number = self.values[name]
        if number is None:
            raise ModelError(
                f"{self.name}.{name} has no value",
                argument=f"{self.name}.{name}",
                advice="Give it a value in the model, or fit the model to data.",
            )
        return number

    @property
    def scale(self) -> float:
        """The linear coefficient: the wavelet variance is `scale` times the shape."""
        return self.scale_from(self.value(self.scale_parameter().name))

    @property
    def nonlinear(self) -> Vector:
        """Values of the nonlinear parameters (q,)."""
        return np.array([self.value(p.name) for p in self.nonlinear_parameters()], dtype=np.float64)

    def with_values(self, **values: Value) -> Self:
        """A copy with other values; a plain number leaves a held parameter held."""
        known = [p.name for p in self.parameters]
        for name, value in values.items():
            if name not in known:
                raise self.no_parameter(name)
            if value is not None and not isinstance(value, Fixed) and self.is_fixed(name):
                values[name] = Fixed(value)
        return replace(self, **values)  # type: ignore[type-var]

    @classmethod
    def no_parameter(cls, name: str) -> ModelError:
        """Make the error for a parameter `name` that the process does not have."""
        known = ", ".join(p.name for p in cls.parameters)
        return ModelError(f"{cls.name} has no parameter {name!r}; its parameters are {known}", argument=name, got=name)

    @classmethod
    def scale_parameter(cls) -> Parameter:
        """The one parameter that the scale coefficient is made of."""
        return next(p for p in cls.parameters if p.scale_power is not None)

    @classmethod
    def nonlinear_parameters(cls) -> tuple[Parameter, ...]:
        """The q parameters that the shape depends on."""
        return tuple(p for p in cls.parameters if p.scale_power is None)

    @classmethod
    def scale_from(cls, value: float) -> float:
        """Scale coefficient of a value of the scale parameter: value**scale_power."""
        power = cls.scale_parameter().scale_power
        assert power is not None
        return math.pow(value, power)

    @classmethod
    def value_from(cls, scale: float) -> float:
        """Value (not negative) of the scale parameter that has this scale coefficient."""
        power = cls.scale_parameter().scale_power
        assert power is not None
        return math.pow(scale, 1.0 / power)

    @classmethod
    def standard(cls, nonlinear: Iterable[float] = ()) -> Self:
        """The process with scale coefficient 1 and these nonlinear parameters."""
        names = [p.name for p in cls.nonlinear_parameters()]
        given = dict(zip(names, map(float, nonlinear), strict=True))
        return cls(**given, **{cls.scale_parameter().name: cls.value_from(1.0)})

    @classmethod
    def repeats(cls, count: int) -> str:
        """Say why a sum cannot hold `count` of a process that is not `repeatable`, and what to write instead."""
        return (
            f"all have the same shape, so that no data can distinguish them from a single one; write {cls.name}() once"
        )

    # --- which processes are cases of which, for the choice among models ----------------------------------

    @classmethod
    def smaller(cls) -> tuple[type[Process], ...]:
        """Classes of the processes that this one is for some of its values: those of lower orders. By default none."""
        return ()

    @classmethod
    def joined(cls, other: type[Process]) -> type[Process] | None:
        """The smallest class that it and `other` are both cases of; None where there is none but their sum."""
        return cls if cls is other else None

    # --- the shape, on which estimation stands --------------------------------------------------------

    @classmethod
    def shape(cls, nonlinear: Matrix, levels: int | ArrayLike, rate: float, filter: WaveletFilter = HAAR) -> Matrix:
        """Wavelet variance at scale coefficient 1.

        Parameters
        ----------
        nonlinear : (n, q) array
            n sets of nonlinear parameters; q may be 0.
        levels : int or (J,) array
            Wavelet levels; a number J stands for 1 … J.
        rate : float
            Sampling rate (Hz).
        filter : WaveletFilter
            An override that has a closed form for some filters leaves the others to this.

        Returns
        -------
        (n, J) array
        """
        wanted, made = as_levels(levels), [cls.standard(row) for row in np.asarray(nonlinear)]
        if filter is HAAR and made and cls._gives("state_space"):
            return haar_variances([process.state_space(rate) for process in made], wanted)
        rows = [process._variance_under(filter, wanted, rate) for process in made]
        return np.array(rows, dtype=np.float64).reshape(len(rows), wanted.size)

    @classmethod
    def shape_jacobian(
        cls, nonlinear: Matrix, levels: int | ArrayLike, rate: float, filter: WaveletFilter = HAAR
    ) -> Matrix:
        """Derivative of `shape` by each nonlinear parameter, (n, J, q); by default differences of order 6."""
        wanted, theta = as_levels(levels), np.asarray(nonlinear, dtype=np.float64)
        result = np.zeros((len(theta), wanted.size, theta.shape[1]))
        room = cls.room(theta)
        for k in range(theta.shape[1]):
            step = 0.01 * room[:, k]
            for distance, weight in ((1, 45.0), (2, -9.0), (3, 1.0)):
                for sign in (1, -1):
                    moved = theta.copy()
                    moved[:, k] += sign * distance * step
                    result[:, :, k] += sign * weight * cls.shape(moved, wanted, rate, filter)
            result[:, :, k] /= 60.0 * step[:, None]
        return result

    @classmethod
    def search(cls, samples: int, rate: float) -> tuple[Branch, ...]:
        """Curves along which to look for the one nonlinear parameter, so that the best place can be proven.

        By default none: then starting values come from `scan`, for any number of parameters.
        """
        return ()

    # --- coordinates of the nonlinear parameters, for a process without `search` ------------------------

    @classmethod
    def room(cls, nonlinear: Matrix) -> Matrix:
        """How far each nonlinear parameter may move by itself (n, q); not positive where there is no such process."""
        columns = [p.room(nonlinear[:, k]) for k, p in enumerate(cls.nonlinear_parameters())]
        return np.stack(columns, axis=1) if columns else np.empty((len(nonlinear), 0))

    @classmethod
    def coordinates(cls, nonlinear: Matrix) -> Matrix:
        """Coordinates (n, q) in which every point of R^q is a process; by default parameter by parameter."""
        columns = [p.coordinate(nonlinear[:, k]) for k, p in enumerate(cls.nonlinear_parameters())]
        return np.stack(columns, axis=1) if columns else np.empty((len(nonlinear), 0))

    @classmethod
    def at_coordinates(cls, z: NDArray[Any]) -> NDArray[Any]:
        """Nonlinear parameters (n, q) at coordinates; analytic, as derivatives are taken by complex steps;
        `z` is (n, q)."""
        columns = [p.at_coordinate(z[:, k]) for k, p in enumerate(cls.nonlinear_parameters())]
        return np.stack(columns, axis=1) if columns else np.empty((len(z), 0))

    @classmethod
    def scan(cls, samples: int, rate: float) -> Matrix:
        """Ends (q, 2) of the coordinates among which starting values are sought; estimates may lie beyond."""
        return np.array([p.scanned(samples, rate) for p in cls.nonlinear_parameters()]).reshape(-1, 2)

    @classmethod
    def drawn(cls, occasion: Occasion, rng: np.random.Generator, draws: int, before: tuple[Matrix, ...]) -> Matrix:
        """Starting values as the paper draws them (its Algorithm 3): (draws, 1 + q), the scale coefficient first.

        Where the paper has no rule, the coordinates are uniform over `scan`, and the scale is such that the process
        has a uniform share of the sum of the wavelet variances.

        Parameters
        ----------
        occasion : Occasion
            What the starting values are for: the data and the other terms.
        rng : numpy.random.Generator
            The source of the draws.
        draws : int
            How many.
        before : tuple of (draws, q) array
            The nonlinear parameters drawn for earlier terms of the same class.
        """
        ends = cls.scan(occasion.samples, occasion.rate)
        nonlinear = cls.at_coordinates(ends[:, 0] + rng.random((draws, len(ends))) * (ends[:, 1] - ends[:, 0]))
        shapes = cls.shape(nonlinear, occasion.levels, occasion.rate, occasion.filter)
        scales = rng.random(draws) * occasion.total / np.sum(shapes, axis=1)
        return np.column_stack([scales, nonlinear])

    # --- theory of a process whose values are complete -------------------------------------------------

    def wavelet_variance(self, levels: int | ArrayLike, rate: float, filter: str | WaveletFilter = HAAR) -> Vector:
        """Wavelet variance ν_j² (J,), in u² for a signal in u, at `levels` and `rate` (Hz) under a filter."""
        shape = self.shape(self.nonlinear.reshape(1, -1), levels, as_rate(rate), find_filter(filter))
        return np.asarray(self.scale * shape[0], dtype=np.float64)

    def running_sum_covariance(self, lags: ArrayLike, rate: float) -> Vector:
        """Generalised covariance K(m) of the running sum, up to what second differences remove.

        For a stationary process K(m) = −½ Var(sum of |m| samples); ν_j² = [6K(0) − 8K(h) + 2K(2h)]/τ².
        """
        m, rate = np.abs(as_lags(lags)), as_rate(rate)
        self._require("running_sum_covariance")
        if self.has("state_space"):
            return -0.5 * self.state_space(rate).block_variance(m)
        longest = int(m.max(initial=0))
        if longest > _LONGEST_SUM:
            raise MissingTheoryError(
                f"{self.name} derives its running-sum covariance by summation, up to lag {_LONGEST_SUM} at most; "
                f"got {longest}",
                got=longest,
                advice="Define `running_sum_covariance` or `state_space` in {process}.",
                process=type(self).__name__,
            )
        r = self.autocovariance(np.arange(longest + 1), rate)
        # Var S_{m+1} − Var S_m = r(0) + 2 Σ_{k=1..m} r(k)
        steps = r[0] + 2.0 * (np.cumsum(r) - r[0])
        return -0.5 * np.concatenate(([0.0], np.cumsum(steps)))[m]

    def autocovariance(self, lags: ArrayLike, rate: float) -> Vector:
        """Autocovariance r(k) in u² at integer `lags`."""
        self._require("autocovariance")
        return self.state_space(as_rate(rate)).autocovariance(as_lags(lags))

    def generalised_covariance(self, lags: ArrayLike, rate: float) -> Vector:
        """Covariance A(m) at integer `lags` (u²), up to a constant, which filters that sum to zero remove.

        Of a stationary process A(m) = r(m), or r(m) − r(0); of others −½ E(X_{t+m} − X_t)². A mean is no part of it.
        """
        self._require("generalised_covariance")
        if self.has("autocovariance"):
            return self.autocovariance(lags, rate)
        m = as_lags(lags)
        before, here, after = (self.running_sum_covariance(m + shift, rate) for shift in (-1, 0, 1))
        return np.asarray((here - before) - (after - here))

    def allan_variance(self, clusters: ArrayLike, rate: float) -> Vector:
        """Allan variance (u²) of means over `clusters` of n samples, any whole n ≥ 1: twice ν² at scale 2n.

        σ²(n) = [3K(0) − 4K(n) + K(2n)]/n², K the covariance of the running sum.
        """
        n = as_clusters(clusters)
        self._require("allan_variance")
        k0, k1, k2 = (self.running_sum_covariance(factor * n, rate) for factor in (0, 1, 2))
        return np.asarray((3.0 * k0 - 4.0 * k1 + k2) / np.square(n, dtype=np.float64))

    def psd(self, frequencies: ArrayLike, rate: float) -> Vector:
        """Two-sided power spectral density (u²/Hz) of the sampled process at |f| ≤ rate/2 (Hz).

        S(f) = Δt Σ_k r(k) exp(−2πi f k Δt); its integral over [−rate/2, rate/2] is the variance.
        """
        self._require("psd")
        rate = as_rate(rate)
        return self.state_space(rate).psd(as_frequencies(frequencies, rate), rate)

    def state_space(self, rate: float) -> StateSpace:
        """The process as F, Q, H, R, m0, P0."""
        raise self.missing("state_space")

    def continuous(self, rate: float) -> ContinuousStateSpace | None:
        """The system in continuous time whose steps at `rate` are those of `state_space`; None where there is none."""
        return ContinuousStateSpace.of(self.state_space(rate), rate)

    def coefficient_covariance(self, at: LagGrid, rate: float) -> Vector:
        """2^(j+k) Cov(W_{j,t}, W_{k,t+u}) of Haar wavelet coefficients: (n,) in u², for n pairs of levels and lags u.

        `at` holds, each (n,), the half-scales 2^(j−1) ≤ 2^(k−1) of the pairs as `fine` and `coarse`, and the `lag` u.
        """
        raise self.missing("coefficient_covariance")

    @property
    def error_cumulant(self) -> float:
        """Fourth cumulant κ₄ (u⁴) of the errors e_t of a process X_t = e_t − e_{t−1}; 0 where they are Gaussian.

        Uniform errors have −1.2 Var² e: squared wavelet coefficients then scatter less than a Gaussian signal's.
        """
        return 0.0

    def line(self, rate: float) -> tuple[float, float] | None:
        """Power P (u²) and cycles per sample of a sinusoid of fixed amplitude and random phase; None of noise.

        The wavelet coefficients of a line are not Gaussian, and their squares scatter in a way of their own.
        """
        return None

    def decays(self, rate: float) -> tuple[float, ...]:
        """Rates λ per sample of the exponentials in `coefficient_covariance`; negative where they alternate in sign."""
        return ()

    def mean(self, t: ArrayLike) -> Vector:
        """Mean at sample numbers t; 0 but for a drift."""
        return np.zeros(np.shape(t))

    def simulate(
        self, n: int, rate: float, rng: np.random.Generator | int, paths: int | None = None
    ) -> np.ndarray[Any, np.dtype[np.float64]]:
        """Gaussian sample paths: (n,), or (paths, n). `rng` is a NumPy Generator or a seed.

        From the state space, or of a stationary autocovariance by embedding it in that of a circle.
        """
        self._require("simulate")
        (n, count), rate, generator = as_paths(n, paths), as_rate(rate), as_rng(rng)
        if self.has("state_space"):
            out = self.state_space(rate).simulate(n, generator, count)
        else:
            roots = circulant_embedding.safe_amplitudes(
                lambda lags: self.autocovariance(lags.astype(np.int64), rate), n
            )
            out = circulant_embedding.paths(roots, n, generator, count)
        return out.reshape(shape_of_paths(n, paths))

    def correlation_time(self, rate: float) -> float | None:
        """Correlation time (s): 0 for white, inf for wandering processes, None where it is not known."""
        return None

    def remarks(self, term: str, samples: int, rate: float) -> tuple[Remark, ...]:
        """Return what to know about values that were estimated from `samples` samples at `rate` (Hz).

        Parameters
        ----------
        term : str
            Name of the process in its model, as "GM[1]".
        samples : int
        rate : float
            Samples per second (Hz).
        """
        return ()

    def physical(self, rate: float) -> tuple[Physical, ...]:
        """What the process is in continuous time, in the terms of datasheets; by default nothing.

        Each number with its derivatives by the logarithms of the parameters, from which its interval follows.
        """
        return ()

    # --- which theory there is ------------------------------------------------------------------------

    @classmethod
    def has(cls, theory: str) -> bool:
        """Whether the process has this theory, in closed form or derived.

        `theory` is the name of one of the methods above, from "wavelet_variance" to "simulate".
        """
        if theory not in _SOURCES:
            raise OptionError(argument="theory", expected=f"one of {', '.join(_SOURCES)}", got=theory)
        if cls._gives(theory):
            return True
        if theory in _NEEDS_STATIONARITY and not cls.stationary:
            return False
        return any(cls.has(source) for source in _SOURCES[theory])

    @classmethod
    def _gives(cls, theory: str) -> bool:
        attribute = "shape" if theory == "wavelet_variance" else theory
        return _function(getattr(cls, attribute)) is not _function(getattr(Process, attribute))

    def _require(self, theory: str) -> None:
        if not self.has(theory):
            raise self.missing(theory)

    def missing(self, theory: str) -> MissingTheoryError:
        """Make the error for theory that the process does not define; the advice lists what it defines."""
        defined = [name for name in _SOURCES if self.has(name)]
        if _function(type(self).mean) is not Process.mean:
            defined.append("mean")
        what = theory.replace("_", " ").replace("running sum", "running-sum").replace("psd", "power spectral density")
        message = "cannot be simulated" if theory == "simulate" else f"has no {what}"
        return MissingTheoryError(
            f"{self.name} {message}{'' if self.stationary else ' (it is not stationary)'}",
            advice="It defines {defined}.",
            theory=theory,
            process=self.name,
            defined=", ".join(defined),
        )

    def _variance_under(
        self, filter: WaveletFilter, levels: np.ndarray[Any, np.dtype[np.int64]], rate: float
    ) -> Vector:
        """Wavelet variance from whatever theory the process gives."""
        if filter is HAAR:
            return self._haar_variance(levels, rate)
        if self._gives("state_space") and self.stationary:
            return filtered.state_space_variance(self.state_space(rate), filter, levels)
        longest = filtered.lags_needed(filter, int(levels[-1]))
        if longest > _LONGEST_SUM or not self.has("running_sum_covariance"):
            raise MissingTheoryError(
                f"{self.name} derives its wavelet variance under the filter {filter.name} by summation of its "
                f"autocovariance, up to lag {_LONGEST_SUM} at most; level {levels[-1]} needs lag {longest}",
                got=filter.name,
                advice="Use {--filter=haar}, or define `{method}` in {process}.",
                method="state_space" if self.stationary else "shape",
                process=type(self).__name__,
            )
        if self._gives("autocovariance"):
            covariance = self.autocovariance(np.arange(longest), rate)
        else:
            k = self.running_sum_covariance(np.arange(-1, longest + 1), rate)
            covariance = 2.0 * k[1:-1] - k[:-2] - k[2:]
        return filtered.autocovariance_variance(covariance, filter, levels)

    def _haar_variance(self, levels: np.ndarray[Any, np.dtype[np.int64]], rate: float) -> Vector:
        """Wavelet variance from whatever theory the process gives; the block sums never cancel, K may."""
        if self._gives("state_space"):
            return self.state_space(rate).haar_variance(levels)
        h = 2 ** (levels - 1)
        k0 = self.running_sum_covariance(np.zeros(1, dtype=np.int64), rate)
        k1, k2 = self.running_sum_covariance(h, rate), self.running_sum_covariance(2 * h, rate)
        return np.asarray((6.0 * k0 - 8.0 * k1 + 2.0 * k2) / (4.0 * np.ldexp(1.0, 2 * (levels - 1))))

    # --- algebra and text -----------------------------------------------------------------------------

    def __add__(self, other: Process | Model) -> Model:
        from gmwm.processes.model import Model

        return Model((self,)) + other

    def __mul__(self, count: int) -> Model:
        from gmwm.processes.model import Model

        return Model((self,)) * count

    __rmul__ = __mul__

    def __radd__(self, other: int) -> Model:
        from gmwm.processes.model import Model

        # sum() begins with 0.
        return Model((self,)) if isinstance(other, int) and other == 0 else NotImplemented

    def __str__(self) -> str:
        fields = {p.name: getattr(self, p.name) for p in self.parameters}
        given = [f"{name}={value!r}" for name, value in fields.items() if value is not None]
        return f"{self.name}({', '.join(given)})" if given else self.name

    def __repr__(self) -> str:
        return str(self) if str(self).endswith(")") else f"{self}()"


def _function(method: Any) -> Any:
    return getattr(method, "__func__", method)


# --- what a class must be to be registered ------------------------------------------------------------


def _check_name(cls: type[Process]) -> None:
    """A name is given once, however it is spelled; but a class that is defined anew takes the place of the older."""
    older = next((known for name, known in registry.items() if name.casefold() == cls.name.casefold()), None)
    if older is None:
        return
    if not defined_anew(cls, older) or older.name != cls.name:
        raise ModelError(
            f"the name {older.name} belongs to {older.__module__}.{older.__qualname__}"
            f"{', a process of gmwm' if is_own(older) else ''}",
            argument="name",
            got=cls.name,
            advice="Give {process} another name.",
            process=cls.__qualname__,
        )


def _check_calls(cls: type[Process]) -> None:
    """Whether the methods that a class overrides can be called as they will be: as those of `Process`."""
    for name, method in vars(cls).items():
        expected = getattr(Process, name, None)
        if name.startswith("_") or not isfunction(_function(method)) or not callable(expected):
            continue
        wanted = {
            n: p for n, p in signature(expected).parameters.items() if p.kind not in (p.VAR_POSITIONAL, p.VAR_KEYWORD)
        }
        needed = [name for name, p in wanted.items() if p.default is p.empty]
        try:
            given = signature(getattr(cls, name))
            given.bind(*needed)
            given.bind(*wanted)
        except TypeError as error:
            of_class = ismethod(expected)
            written = ", ".join((["cls"] if of_class else []) + [f"{w}=…" if w not in needed else w for w in wanted])
            raise ModelError(
                f"{cls.__name__}.{name} must be {'a class method, ' if of_class else ''}{name}({written}); "
                f"it is {name}{signature(_function(method))}",
                argument=name,
            ) from error
