"""Base class of all noise processes.

The wavelet variance is a scale coefficient times a shape of nonlinear parameters. A subclass defines a piece of theory;
defaults derive the rest. The registry serves the parser, the command line, the documentation and `tests/laws`."""

from __future__ import annotations

import math
from abc import ABC
from collections.abc import Callable, Iterable
from functools import cache, cached_property, lru_cache
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gmwm.base.arrays import Matrix, Vector, as_levels, as_rate, freeze
from gmwm.base.errors import MissingTheoryError, ModelError, OptionError
from gmwm.base.extras import admit_guests
from gmwm.base.remarks import Remark
from gmwm.theory.continuous_statespace import ContinuousStateSpace
from gmwm.theory.filters import HAAR, WaveletFilter, find_filter
from gmwm.theory.processes import circulant_embedding, filtered, validation
from gmwm.theory.processes.haar_covariance import HaarTheory
from gmwm.theory.processes.parameter import Branch, Fixed, Occasion, Parameter, Physical, Value
from gmwm.theory.statespace import StateSpace, haar_variances

if TYPE_CHECKING:
    from typing_extensions import Self

    from gmwm.theory.processes.model import Model

registry: dict[str, type[Process]] = {}  # all processes by name, in the order in which they are listed

Theory = Literal[
    "wavelet_variance", "running_sum_covariance", "autocovariance", "psd", "state_space", "simulate",
    "coefficient_covariance", "memory", "generalised_covariance", "allan_variance",
]  # fmt: skip

# The sources from which each piece of theory can be derived. The first source that the process defines is used.
_SOURCES: dict[str, tuple[str, ...]] = {
    "wavelet_variance": ("running_sum_covariance", "state_space", "autocovariance"),
    "running_sum_covariance": ("state_space", "autocovariance"), "autocovariance": ("state_space",),
    "psd": ("state_space",), "simulate": ("state_space", "autocovariance"), "state_space": (),
    "coefficient_covariance": ("memory",), "memory": (),
    "generalised_covariance": ("autocovariance", "running_sum_covariance"),
    "allan_variance": ("running_sum_covariance",),
}  # fmt: skip
_NEEDS_STATIONARITY = frozenset({"running_sum_covariance", "autocovariance", "psd"})
# The longest sum over lags: 2^24 doubles take 128 MB. Pinned by test_a_sum_that_would_take_too_long_is_refused.
_LONGEST_SUM = 2**24


class Process(HaarTheory, ABC):
    """Base class of noise processes. Each process is a frozen dataclass whose fields are its parameters.

    All theory is per sample and in SI units; u is the unit of the signal. The page docs/contributing/add-a-process.md
    explains how to add a process. The methods share these arguments:

    - `rate`: sampling rate (Hz)
    - `levels`: number J of levels, or an ascending list of levels
    - `lags`, `clusters`: arrays of integers (samples)
    - `frequencies`: array (Hz), within ±rate/2
    - `filter`: name or `WaveletFilter`, see `gmwm.filters.find_filter`
    - `samples`: length N of a recording (samples)
    - `nonlinear`: (n, q) array, the q nonlinear parameters of n processes
    - `n`, `paths`: number of samples and number of sample paths
    - `rng`: NumPy Generator or seed

    A method raises `MissingTheoryError` if the process does not define the theory; check with `has`.

    Examples
    --------
    A moving average of order 1, defined by its autocovariance; `register=False` keeps it out of the registry:

    >>> from dataclasses import dataclass
    >>> @dataclass(frozen=True, repr=False)
    ... class MA1(Process, register=False):
    ...     name, title = "MyMA", "Moving average of order 1"
    ...     parameters = (
    ...         Parameter("theta", "θ", "coefficient", domain="between"),
    ...         Parameter("sigma2", "σ²", "innovation variance", signal_power=2, scale_power=1),
    ...     )
    ...     theta: Value = None
    ...     sigma2: Value = None
    ...     def autocovariance(self, lags, rate):
    ...         k, theta = np.abs(lags), self.value("theta")
    ...         return self.scale * np.where(k == 0, 1 + theta**2, np.where(k == 1, theta, 0.0))
    >>> MA1(theta=0.5, sigma2=4.0).wavelet_variance(2, rate=100.0)
    array([1.5, 1.5])
    """

    name: ClassVar[str]
    """Short name that model texts use, such as "GM"."""
    title: ClassVar[str]
    """Full name, such as "Gauss-Markov process"."""
    parameters: ClassVar[tuple[Parameter, ...]]
    """Parameters, in the order of the fields."""
    repeatable: ClassVar[bool] = False
    """Whether a sum can contain several terms of this process. The terms must differ in a shape parameter."""
    stationary: ClassVar[bool] = True
    """Whether the process is stationary, so that it has an autocovariance."""
    approximate: ClassVar[bool] = False
    """Whether `state_space` is an approximation (see the module `ladder`), from which no other theory is derived."""
    parametrises: ClassVar[str | None] = None
    """Common name of classes of one process, such as `AR1` and `GM`; a model may use only one of them."""

    def __init_subclass__(cls, *, register: bool = True, abstract: bool = False, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        if abstract:
            return
        validation.check_members(cls, _SOURCES["wavelet_variance"])
        validation.check_calls(cls, Process)
        if register:
            validation.check_name(cls, registry)
            registry[cls.name] = cls

    def __post_init__(self) -> None:
        for parameter in self.parameters:
            object.__setattr__(self, parameter.name, parameter.checked(getattr(self, parameter.name), self.name))

    # --- values ---------------------------------------------------------------------------------------

    @property
    def values(self) -> dict[str, float | None]:
        """Value of each parameter, fixed or not; None if it is to be estimated."""
        return {p.name: v.value if isinstance(v := getattr(self, p.name), Fixed) else v for p in self.parameters}

    def is_fixed(self, name: str) -> bool:
        """Whether the parameter `name` is fixed."""
        return isinstance(getattr(self, name), Fixed)

    @property
    def is_complete(self) -> bool:
        """Whether every parameter has a value."""
        return all(getattr(self, p.name) is not None for p in self.parameters)

    @property
    def shape_is_fixed(self) -> bool:
        """Whether every parameter that changes more than the scale is fixed."""
        return all(self.is_fixed(p.name) for p in self.nonlinear_parameters())

    def value(self, name: str) -> float:
        """Value of the parameter `name`, fixed or not. Raises ModelError if it has none."""
        number: float | None = v.value if isinstance(v := self.__dict__[name], Fixed) else v
        if number is None:
            raise ModelError(
                f"{self.name}.{name} has no value",
                argument=f"{self.name}.{name}",
                advice="Give it a value in the model, or fit the model to data.",
            )
        return number

    @cached_property
    def scale(self) -> float:
        """Scale coefficient, by which the shape is multiplied to give the wavelet variance."""
        return self.scale_from(self.value(self.scale_parameter().name))

    @property
    def nonlinear(self) -> Vector:
        """Values of the nonlinear parameters (q,)."""
        return np.array([self.value(p.name) for p in self.nonlinear_parameters()], dtype=np.float64)

    def with_values(self, **values: Value) -> Self:
        """Return a copy with other values. A fixed parameter stays fixed if its new value is a number."""
        names = [p.name for p in self.parameters]
        for name, value in values.items():
            if name not in names:
                raise self.no_parameter(name)
            if value is not None and not isinstance(value, Fixed) and self.is_fixed(name):
                values[name] = Fixed(value)
        return type(self)(**{name: getattr(self, name) for name in validation.fields_of(type(self))} | values)

    @classmethod
    def no_parameter(cls, name: str) -> ModelError:
        """Return the error for a parameter `name` that the process does not have."""
        names = ", ".join(p.name for p in cls.parameters)
        return ModelError(f"{cls.name} has no parameter {name!r}; its parameters are {names}", argument=name, got=name)

    @classmethod
    @cache
    def scale_parameter(cls) -> Parameter:
        """Return the parameter that scales the wavelet variance."""
        return next(p for p in cls.parameters if p.scale_power is not None)

    @classmethod
    @cache
    def nonlinear_parameters(cls) -> tuple[Parameter, ...]:
        """Return the q parameters that change the shape of the wavelet variance."""
        return tuple(p for p in cls.parameters if p.scale_power is None)

    @classmethod
    def scale_from(cls, value: float) -> float:
        """Return the scale coefficient value**scale_power for a value of the scale parameter."""
        power = cls.scale_parameter().scale_power
        assert power is not None
        return math.pow(value, power)

    @classmethod
    def value_from(cls, scale: float) -> float:
        """Return the value (at least 0) of the scale parameter that gives the scale coefficient `scale`."""
        power = cls.scale_parameter().scale_power
        assert power is not None
        return math.pow(scale, 1.0 / power)

    def with_scale(self, scale: float) -> Self:
        """Return the same process with the scale coefficient `scale`."""
        return self.with_values(**{self.scale_parameter().name: self.value_from(scale)})

    @classmethod
    def standard(cls, nonlinear: Iterable[float] = ()) -> Self:
        """Return the process with scale coefficient 1 and these nonlinear parameters."""
        shape = dict(zip((p.name for p in cls.nonlinear_parameters()), map(float, nonlinear), strict=True))
        return cls(**shape, **{cls.scale_parameter().name: cls.value_from(1.0)})

    @classmethod
    def instead_of_repeats(cls, count: int) -> str:
        """Return the single term to write instead of `count` terms of a process that is not `repeatable`."""
        return f"{cls.name}()"

    # --- special cases of processes, which the choice among models uses ---------------------------------

    @classmethod
    def smaller(cls) -> tuple[type[Process], ...]:
        """Return the classes that are special cases of this class, such as lower orders; none by default."""
        return ()

    @classmethod
    def joined(cls, other: type[Process]) -> type[Process] | None:
        """Return the smallest class that has this class and `other` as special cases; None if there is no such
        class."""
        return cls if cls is other else None

    # --- the shape, which estimation uses -------------------------------------------------------------

    @classmethod
    def shape(cls, nonlinear: Matrix, levels: int | ArrayLike, rate: float, filter: WaveletFilter = HAAR) -> Matrix:
        """Compute the wavelet variance (n, J) of n processes for scale coefficient 1; q may be 0.

        A subclass that has closed forms for some filters calls `super().shape` for the others."""
        numbers, processes = as_levels(levels), [cls.standard(row) for row in np.asarray(nonlinear)]
        # An exact state space is preferred: differences of K lose digits by cancellation, its block sums do not.
        if processes and cls._derives("state_space") and (filter is HAAR or cls.stationary):
            spaces = [process.state_space(rate) for process in processes]
            if filter is HAAR:
                return haar_variances(spaces, numbers)
            return filtered.state_space_variances(spaces, filter, numbers)
        rows = [process._variance_under(filter, numbers, rate) for process in processes]
        return np.array(rows, dtype=np.float64).reshape(len(rows), numbers.size)

    @classmethod
    def shape_jacobian(
        cls, nonlinear: Matrix, levels: int | ArrayLike, rate: float, filter: WaveletFilter = HAAR
    ) -> Matrix:
        """Compute the derivatives (n, J, q) of `shape` with respect to the parameters; by central differences of order
        6."""
        return cls._differences(nonlinear, lambda theta: cls.shape(theta, levels, rate, filter))

    @classmethod
    def _differences(cls, nonlinear: Matrix, function: Callable[[Matrix], Matrix]) -> NDArray[np.float64]:
        """Compute the derivatives (n, J, q) of a function (n, J) of the parameters."""
        theta = np.asarray(nonlinear, dtype=np.float64)
        (n, q), steps = theta.shape, 0.01 * cls.room(theta)
        if q == 0:
            return np.zeros((n, function(theta).shape[1], 0))
        distances, weights = np.array([1, 2, 3, -1, -2, -3]), np.array([45.0, -9.0, 1.0, -45.0, 9.0, -1.0])
        moved = np.tile(theta, (q, 6, 1, 1))
        for k in range(q):
            moved[k, :, :, k] += distances[:, None] * steps[:, k]
        values = function(moved.reshape(-1, q)).reshape(q, 6, n, -1)
        return np.asarray(np.einsum("d,kdnj->njk", weights, values) / (60.0 * steps[:, None, :]))

    @classmethod
    def moments(cls, nonlinear: Matrix, levels: int | ArrayLike, rate: float, filter: WaveletFilter = HAAR) -> Matrix:
        """Compute `shape`, and for a filter with lags the moments of the levels −l; see `WaveletFilter`."""
        if not filter.lags:
            return cls.shape(nonlinear, levels, rate, filter)
        places, lags, positive = _apart(filter.numbers(levels))
        values = cls.shape(nonlinear, positive, rate, HAAR)
        return np.concatenate([values[:, :1] + cls.lag_covariances(nonlinear, lags, rate), values[:, places]], axis=1)

    @classmethod
    def moments_jacobian(
        cls, nonlinear: Matrix, levels: int | ArrayLike, rate: float, filter: WaveletFilter = HAAR
    ) -> NDArray[np.float64]:
        """Compute the derivatives (n, J, q) of `moments` with respect to the parameters."""
        if not filter.lags:
            return cls.shape_jacobian(nonlinear, levels, rate, filter)
        places, lags, positive = _apart(filter.numbers(levels))
        slopes = cls.shape_jacobian(nonlinear, positive, rate, HAAR)
        lagged = cls._differences(nonlinear, lambda theta: cls.lag_covariances(theta, lags, rate))
        return np.concatenate([slopes[:, :1] + lagged, slopes[:, places]], axis=1)

    @classmethod
    def lag_covariances(cls, nonlinear: Matrix, lags: NDArray[np.int64], rate: float) -> Matrix:
        """Compute E W_{1,t} W_{1,t+l} (n, L) of Haar coefficients at lags l, a quarter of the autocovariance of first
        differences, for scale coefficient 1."""
        rows = np.empty((len(nonlinear), lags.size))
        for row, theta in zip(rows, np.asarray(nonlinear), strict=True):
            process = cls.standard(theta)
            before, here, after = process.generalised_covariance(lags + np.array([[-1], [0], [1]]), rate)
            step = float(process.mean(1.0) - process.mean(0.0))
            row[:] = ((here - before) - (after - here) + step**2) / 4.0
        return rows

    @classmethod
    def search(cls, samples: int, rate: float) -> tuple[Branch, ...]:
        """Return curves that cover the domain of a single nonlinear parameter.

        A fit along them can be proven to be the global optimum. Without curves, starting values come from `scan`."""
        return ()

    # --- coordinates of the nonlinear parameters, for a process without `search` ------------------------

    @classmethod
    def room(cls, nonlinear: Matrix) -> Matrix:
        """Compute the distance (n, q) of each nonlinear parameter from the nearest end of its domain; ≤ 0 outside."""
        columns = [p.room(nonlinear[:, k]) for k, p in enumerate(cls.nonlinear_parameters())]
        return np.stack(columns, axis=1) if columns else np.empty((len(nonlinear), 0))

    @classmethod
    def coordinates(cls, nonlinear: Matrix) -> Matrix:
        """Transform nonlinear parameters (n, q) to unconstrained coordinates (n, q), by default each one separately."""
        columns = [p.coordinate(nonlinear[:, k]) for k, p in enumerate(cls.nonlinear_parameters())]
        return np.stack(columns, axis=1) if columns else np.empty((len(nonlinear), 0))

    @classmethod
    def at_coordinates(cls, z: NDArray[Any]) -> NDArray[Any]:
        """Compute the nonlinear parameters (n, q) at coordinates `z` (n, q), which are complex for derivatives."""
        columns = [p.at_coordinate(z[:, k]) for k, p in enumerate(cls.nonlinear_parameters())]
        return np.stack(columns, axis=1) if columns else np.empty((len(z), 0))

    @classmethod
    def scan(cls, samples: int, rate: float) -> Matrix:
        """Return the lowest and highest coordinates (q, 2) of starting values. Estimates may lie outside this range."""
        return np.array([p.scanned(samples, rate) for p in cls.nonlinear_parameters()]).reshape(-1, 2)

    @classmethod
    def drawn(cls, occasion: Occasion, rng: np.random.Generator, draws: int, before: tuple[Matrix, ...]) -> Matrix:
        """Draw starting values (draws, 1 + q), with the scale coefficient first, by Algorithm 3 of Balamuta et al.

        `occasion` has the data and the other terms, `draws` is the number of draws, and `before` has the nonlinear
        parameters (draws, q) of earlier terms of the same class. By default, the coordinates are uniform over the range
        of `scan`, and the share of the process in the sum of the wavelet variances is uniform."""
        ends = cls.scan(occasion.samples, occasion.rate)
        nonlinear = cls.at_coordinates(ends[:, 0] + rng.random((draws, len(ends))) * (ends[:, 1] - ends[:, 0]))
        shapes = cls.moments(nonlinear, occasion.levels, occasion.rate, occasion.filter)
        return np.column_stack([rng.random(draws) * occasion.total / np.sum(shapes, axis=1), nonlinear])

    # --- theory; every parameter needs a value ---------------------------------------------------------

    def wavelet_variance(self, levels: int | ArrayLike, rate: float, filter: str | WaveletFilter = HAAR) -> Vector:
        """Compute the wavelet variance ν_j² (J,) in u²."""
        return self.scale * self.unit_shape(levels, as_rate(rate), find_filter(filter))

    def unit_shape(self, levels: int | ArrayLike, rate: float, filter: WaveletFilter) -> Vector:
        """Compute the wavelet variance (J,) for scale coefficient 1; fits ask for the same ones several times."""
        theta, numbers = self.nonlinear.tobytes(), filter.numbers(levels).tobytes()
        return _unit_shape(type(self), theta, numbers, rate=rate, filter=filter)

    def running_sum_covariance(self, lags: ArrayLike, rate: float) -> Vector:
        """Compute the generalised covariance K(m) of the running sum (u²) at lags m.

        It is defined up to a linear function of |m|. For a stationary process K(m) = −½ Var(sum of |m| samples). The
        Haar wavelet variance is ν_j² = [6K(0) − 8K(h) + 2K(2h)]/τ², with τ = 2^j and h = τ/2 samples."""
        m, rate = np.abs(validation.as_lags(lags)), as_rate(rate)
        self._require("running_sum_covariance")
        if self._derives("state_space"):
            return -0.5 * self.state_space(rate).block_variance(m.ravel()).reshape(m.shape)
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
        """Compute the autocovariance r(k) in u² at integer `lags` k."""
        self._require("autocovariance")
        return self.state_space(as_rate(rate)).autocovariance(validation.as_lags(lags))

    def generalised_covariance(self, lags: ArrayLike, rate: float) -> Vector:
        """Compute the generalised covariance A(m) in u² at integer `lags` m.

        It is defined up to a constant, which wavelet filters remove. For a stationary process A(m) is r(m) or
        r(m) − r(0), with the autocovariance r; otherwise A(m) = −½ Var(X_{t+m} − X_t)."""
        self._require("generalised_covariance")
        if self.has("autocovariance"):
            return self.autocovariance(lags, rate)
        m = validation.as_lags(lags)
        before, here, after = (self.running_sum_covariance(m + shift, rate) for shift in (-1, 0, 1))
        return np.asarray((here - before) - (after - here))

    def allan_variance(self, clusters: ArrayLike, rate: float) -> Vector:
        """Compute the Allan variance (u²) of clusters of n samples, for any integer n ≥ 1.

        σ²(n) = [3K(0) − 4K(n) + K(2n)]/n², where K is the `running_sum_covariance`. For n = 2^(j−1) it is twice the
        Haar wavelet variance ν_j²."""
        n = validation.as_clusters(clusters)
        self._require("allan_variance")
        k0, k1, k2 = (self.running_sum_covariance(factor * n, rate) for factor in (0, 1, 2))
        return np.asarray((3.0 * k0 - 4.0 * k1 + k2) / np.square(n, dtype=np.float64))

    def psd(self, frequencies: ArrayLike, rate: float) -> Vector:
        """Compute the two-sided power spectral density (u²/Hz) of the sampled process at |f| ≤ rate/2 (Hz).

        S(f) = Δt Σ_k r(k) exp(−2πi f k Δt), Δt = 1/rate; its integral over [−rate/2, rate/2] is the variance."""
        self._require("psd")
        rate = as_rate(rate)
        return self.state_space(rate).psd(validation.as_frequencies(frequencies, rate), rate)

    def state_space(self, rate: float) -> StateSpace:
        """Return the state space in discrete time, with the matrices F, Q, H, R, m0 and P0."""
        raise self.missing("state_space")

    def continuous(self, rate: float) -> ContinuousStateSpace | None:
        """Return the state space in continuous time, whose discretisation at `rate` is `state_space`; None if none."""
        return ContinuousStateSpace.of(self.state_space(rate), rate)

    @property
    def error_cumulant(self) -> float:
        """Fourth cumulant κ₄ (u⁴) of the errors e_t of a process X_t = e_t − e_{t−1}; 0 if they are Gaussian.

        For uniform errors it is −1.2 (Var e)². The squares of the wavelet coefficients then vary less than for a
        Gaussian signal."""
        return 0.0

    def line(self, rate: float) -> tuple[float, float] | None:
        """Return the power (u²) and frequency (cycles per sample) of a sinusoid; None for Gaussian noise."""
        return None

    def oscillation(self) -> float | None:
        """Return the frequency (Hz) of a process that is nearly periodic; None for noise. N, K and B describe noise."""
        return None

    def mean(self, t: ArrayLike) -> Vector:
        """Return the mean (u) at sample numbers t; it is 0 for every process except a drift."""
        return np.zeros(np.shape(t))

    def simulate(
        self, n: int, rate: float, rng: np.random.Generator | int, paths: int | None = None
    ) -> np.ndarray[Any, np.dtype[np.float64]]:
        """Simulate Gaussian sample paths, an array (n,) or (paths, n).

        The default uses the state space if it is exact, and otherwise the autocovariance and circulant embedding."""
        self._require("simulate")
        (n, count), rate, generator = validation.as_paths(n, paths), as_rate(rate), validation.as_rng(rng)
        if self._derives("state_space"):
            out = self.state_space(rate).simulate(n, generator, count)
        else:
            roots = circulant_embedding.safe_amplitudes(
                lambda lags: self.autocovariance(lags.astype(np.int64), rate), n
            )
            out = circulant_embedding.paths(roots, n, generator, count)
        return out.reshape(validation.shape_of_paths(n, paths))

    def correlation_time(self, rate: float) -> float | None:
        """Return the correlation time (s); 0 for white noise, inf for nonstationary processes, None if unknown."""
        return None

    def remarks(self, term: str, samples: int, rate: float) -> tuple[Remark, ...]:
        """Return remarks on parameter values that were estimated from a recording; `term` is a label such as
        "GM[1]"."""
        return ()

    def physical(self, rate: float) -> tuple[Physical, ...]:
        """Return the continuous-time coefficients of the process as datasheets state them; none by default."""
        return ()

    # --- defined theory -------------------------------------------------------------------------------

    @classmethod
    def has(cls, theory: str) -> bool:
        """Return whether the process defines the method `theory`, such as "simulate", directly or by derivation."""
        if theory not in _SOURCES:
            raise OptionError(argument="theory", expected=f"one of {', '.join(_SOURCES)}", got=theory)
        possible = cls.stationary or theory not in _NEEDS_STATIONARITY
        return cls._gives(theory) or (possible and any(cls._derives(source) for source in _SOURCES[theory]))

    @classmethod
    def _derives(cls, source: str) -> bool:
        # Theory is derived only from sources that the process defines and that are exact.
        return cls.has(source) and not (source == "state_space" and cls.approximate)

    @classmethod
    def _gives(cls, theory: str) -> bool:
        attribute = "shape" if theory == "wavelet_variance" else theory
        return validation.function_of(getattr(cls, attribute)) is not validation.function_of(
            getattr(Process, attribute)
        )

    def _require(self, theory: str) -> None:
        if not self.has(theory):
            raise self.missing(theory)

    def missing(self, theory: str) -> MissingTheoryError:
        """Return the error for theory that the process does not define; the advice lists the theory that it defines."""
        defined = [name for name in _SOURCES if self.has(name)]
        defined += ["mean"] if validation.function_of(type(self).mean) is not Process.mean else []
        what = theory.replace("_", " ").replace("running sum", "running-sum").replace("psd", "power spectral density")
        what = "cannot be simulated" if theory == "simulate" else f"has no {what}"
        return MissingTheoryError(
            f"{self.name} {what}{'' if self.stationary else ' (it is not stationary)'}", advice="It defines {defined}.",
            theory=theory, process=self.name, defined=", ".join(defined),
        )  # fmt: skip

    def _variance_under(
        self, filter: WaveletFilter, levels: np.ndarray[Any, np.dtype[np.int64]], rate: float
    ) -> Vector:
        """Compute the wavelet variance (J,) under any filter from the theory that the process defines."""
        if filter is HAAR:
            return self._haar_variance(levels, rate)
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
        """Compute the wavelet variance (J,) under the Haar filter."""
        h = 2 ** (levels - 1)
        k0 = self.running_sum_covariance(np.zeros(1, dtype=np.int64), rate)
        k1, k2 = self.running_sum_covariance(h, rate), self.running_sum_covariance(2 * h, rate)
        return np.asarray((6.0 * k0 - 8.0 * k1 + 2.0 * k2) / (4.0 * np.ldexp(1.0, 2 * (levels - 1))))

    # --- algebra and text -----------------------------------------------------------------------------

    def __add__(self, other: Process | Model) -> Model:
        from gmwm.theory.processes.model import Model

        return Model((self,)) + other

    def __mul__(self, count: int) -> Model:
        from gmwm.theory.processes.model import Model

        return Model((self,)) * count

    __rmul__ = __mul__

    def __radd__(self, other: int) -> Model:
        from gmwm.theory.processes.model import Model

        return Model((self,)) if isinstance(other, int) and other == 0 else NotImplemented  # sum() begins with 0

    def __str__(self) -> str:
        fields = ((p.name, getattr(self, p.name)) for p in self.parameters)
        values = [f"{name}={value!r}" for name, value in fields if value is not None]
        return f"{self.name}({', '.join(values)})" if values else self.name

    def __repr__(self) -> str:
        return str(self) if str(self).endswith(")") else f"{self}()"


@lru_cache(maxsize=128)
def _unit_shape(kind: type[Process], nonlinear: bytes, levels: bytes, rate: float, filter: WaveletFilter) -> Vector:
    shapes = kind.moments(np.frombuffer(nonlinear).reshape(1, -1), np.frombuffer(levels, np.int64), rate, filter)
    return freeze(np.array(shapes[0], dtype=np.float64))


def _apart(levels: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Return the places of the levels above 0 among these and level 1, the lags, and these levels."""
    above = levels[levels > 0]
    with_first = above if above.size and above[0] == 1 else np.concatenate([[1], above])
    return np.arange(with_first.size)[with_first.size - above.size :], -levels[levels < 0], with_first


def admit_guest_processes() -> None:
    """Import the processes of other packages, which register themselves. Their entry points are in `gmwm.processes`."""
    admit_guests("gmwm.processes", _require_registered)


def _require_registered(name: str, process: object) -> None:
    if process not in registry.values():
        raise TypeError(f"{name} is not a registered subclass of gmwm.processes.Process")
