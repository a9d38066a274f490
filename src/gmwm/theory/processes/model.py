"""Models: sums of independent noise processes."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby
from typing import TYPE_CHECKING, Any, ClassVar, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gmwm.base.arrays import Matrix, Vector, as_rate
from gmwm.base.documents import write_as_text
from gmwm.base.errors import ModelError
from gmwm.recording.signals import Signal
from gmwm.theory.continuous_statespace import ContinuousStateSpace
from gmwm.theory.filters import HAAR, WaveletFilter, find_filter
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.parameter import Fixed, Value
from gmwm.theory.processes.validation import as_paths, as_rng, require_distinct_terms, shape_of_paths
from gmwm.theory.statespace import StateSpace

if TYPE_CHECKING:
    from gmwm.fitting.likelihood import Residuals, Tracks
    from gmwm.fitting.likelihood.tracks import Modelled

MOST_TERMS = 100  # largest number of terms; a wavelet variance has at most 62 levels, so more can never be estimated


class KalmanMethods:
    """Methods that apply a model with values to a recording; `Model`, `Fit` and `LikelihoodFit` inherit from it."""

    @property
    def _modelled(self) -> Modelled:
        """The object itself, with its type for `gmwm.likelihood`."""
        return cast("Modelled", self)

    def kalman_filter(
        self, data: Signal | ArrayLike, rate: float | None = None, *, mean: float | None = None
    ) -> Tracks:
        """Estimate the latent processes at each sample from this and all earlier samples, as a real-time filter does.

        Parameters
        ----------
        data : Signal or (N,) array
            The recording. Gaps of a signal are missing samples; in an array, NaN marks a missing sample.
        rate : float, optional
            Sampling rate (Hz). A model needs it with an array; a fit knows it.
        mean : float, optional
            Mean of the recording, in its unit, if it is known; unknown by default.

        Returns
        -------
        Tracks
            Mean and standard deviation of each latent process at each sample.

        Raises
        ------
        ModelError
            If a parameter has no value, or the model predicts a sample without error.
        MissingTheoryError
            If a term has no state-space form.
        DataError, OptionError
            If the data, the rate or the mean is invalid.

        Examples
        --------
        >>> from gmwm import RW, WN
        >>> model = WN(sigma2=1.0) + RW(gamma2=1e-4)
        >>> tracks = model.kalman_filter(model.simulate(1000, 100.0, rng=1), rate=100.0)
        >>> tracks.labels
        ('WN', 'RW', 'bias')
        """
        from gmwm.fitting.likelihood import filter_tracks

        return filter_tracks(self._modelled, data, rate, mean=mean)

    def smooth(self, data: Signal | ArrayLike, rate: float | None = None, *, mean: float | None = None) -> Tracks:
        """Estimate the latent processes at each sample from the whole recording, by the fixed-interval smoother.

        The parameters, the result and the errors are those of `kalman_filter`: `data`, `rate` and `mean`.

        References
        ----------
        Durbin and Koopman (2012), Time Series Analysis by State Space Methods, 2nd ed., section 4.4.
        """
        from gmwm.fitting.likelihood import smooth_tracks

        return smooth_tracks(self._modelled, data, rate, mean=mean)

    def predict(
        self, data: Signal | ArrayLike, steps: int, rate: float | None = None, *, mean: float | None = None
    ) -> Tracks:
        """Predict the latent processes after the end of a recording, from all of its samples.

        `data`, `rate` and `mean` are the same as for `kalman_filter`.

        Parameters
        ----------
        steps : int
            Number of samples to predict, from 1 to 10 million.

        Returns
        -------
        Tracks
            Mean and standard deviation of each latent process at the `steps` samples after the recording.

        Raises
        ------
        OptionError
            If `steps` is out of range; the other errors are those of `kalman_filter`.

        Examples
        --------
        >>> from gmwm import GM
        >>> model = 1 * GM(beta=1.0, sigma2=4.0)
        >>> ahead = model.predict(model.simulate(1000, 100.0, rng=1), 10_000, rate=100.0, mean=0.0)
        >>> print(f"{ahead.error['GM'][0]:.2f} {ahead.error['GM'][-1]:.2f}")
        0.28 2.00
        """
        from gmwm.fitting.likelihood import predict_tracks

        return predict_tracks(self._modelled, data, steps, rate, mean=mean)

    def residuals(
        self, data: Signal | ArrayLike, rate: float | None = None, *, mean: float | None = None,
        estimated: int | None = None,
    ) -> Residuals:  # fmt: skip
        """Compute the standardised innovations, which are one-step prediction errors over their standard deviations.

        `data`, `rate` and `mean` are the same as for `kalman_filter`.

        Parameters
        ----------
        estimated : int, optional
            Number of parameters that were estimated from this recording. Each of them reduces the degrees of freedom of
            the Ljung-Box test by one. The default is 0 for a model; for a fit it follows from the information matrix.

        Returns
        -------
        Residuals
            The innovations, with tests of whiteness and of normality. They are white and Gaussian with variance 1 if
            the model is correct.

        Examples
        --------
        >>> from gmwm import RW, WN, fit_ml
        >>> x = (WN(sigma2=1.0) + RW(gamma2=1e-4)).simulate(5_000, 100.0, rng=1)
        >>> fit_ml(WN() + RW(), x, rate=100.0).residuals(x).ljung_box().p_value > 0.01
        True
        """
        from gmwm.fitting.likelihood import residuals

        return residuals(self._modelled, data, rate, mean=mean, estimated=estimated)


@dataclass(frozen=True, repr=False, eq=False)
class Model(KalmanMethods):
    """Sum of independent noise processes, X_t = Σ_k X_t^(k), so that ν_j² = Σ_k ν_j²^(k).

    Write it as a sum, `3 * GM() + WN() + RW()`, or as text, `Model.parse("3*GM + WN + RW")`. Two models are equal if
    they have the same terms with the same values, in any order. The order is kept for display, and repeated terms are
    numbered in this order: `GM[1]`, `GM[2]`.

    The methods share their arguments with `Process`: `rate` in Hz; `levels`, their number J or an ascending list;
    `lags` (samples); `frequencies` (Hz); `filter`, a name or a `WaveletFilter`; `n` and `paths`, the number of samples
    and of sample paths; `rng`, a NumPy Generator or a seed. They raise `ModelError` if a parameter has no value,
    `MissingTheoryError` if a term does not define the theory (check with `has`), `OptionError` for a wrong argument.

    Parameters
    ----------
    processes : tuple of Process
        Terms, in the order in which they are displayed.

    Raises
    ------
    ModelError
        If a process occurs twice that cannot be repeated, or one process occurs in two parametrisations.

    Examples
    --------
    >>> from gmwm.processes import GM, WN
    >>> model = 2 * GM() + WN(sigma2=4.0)
    >>> model.terms
    ('GM[1]', 'GM[2]', 'WN')
    >>> model.names
    ('GM[1].beta', 'GM[1].sigma2', 'GM[2].beta', 'GM[2].sigma2', 'WN.sigma2')
    >>> str(model)
    '2*GM + WN(sigma2=4.0)'
    >>> model == WN(sigma2=4.0) + 2 * GM()
    True
    """

    checks_itself: ClassVar[bool] = True  # so that `gmwm.base.kinds` need not
    processes: tuple[Process, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "processes", tuple(self.processes))
        terms: tuple[object, ...] = self.processes
        for term in terms:
            if not isinstance(term, Process):
                raise _no_model(term, "every term of a model must be a process, such as GM()", "processes")
        if not terms:
            raise ModelError("a model needs at least one process; got none", got=terms, argument="processes")
        if (count := len(terms)) > MOST_TERMS:
            raise ModelError(f"a model has at most {MOST_TERMS} terms; got {count}", got=count, argument="processes")
        require_distinct_terms(self.processes)

    @classmethod
    def parse(cls, text: str) -> Model:
        """Read a model from a text such as "3*GM + WN(sigma2=4) + RW"; `str(model)` writes one.

        Parameters
        ----------
        text : str
            A sum of processes. A number in front of a process repeats it: `3*GM`. Values are starting values; write
            them by name or in the order of the parameters: `AR1(phi=0.9)`, `AR1(0.9, 0.1)`. Write `fixed(0.1)` for a
            value that is not estimated. Orders come first: `ARMA(2, 1)`.

        Raises
        ------
        ModelError
            If the text cannot be read, with the position of the error, or the processes cannot be summed.

        Examples
        --------
        >>> Model.parse("AR1(0.9, 0.1)")
        Model('AR1(phi=0.9, sigma2=0.1)')
        """
        from gmwm.theory.processes.parse import parse_model

        return parse_model(text)

    @cached_property
    def terms(self) -> tuple[str, ...]:
        """Label of each term, such as "WN". Terms of the same process are numbered, such as "GM[1]" and "GM[2]"."""
        total, seen, labels = Counter(p.name for p in self.processes), Counter[str](), []
        for process in self.processes:
            seen[process.name] += 1
            labels.append(f"{process.name}[{seen[process.name]}]" if total[process.name] > 1 else process.name)
        return tuple(labels)

    @property
    def by_term(self) -> dict[str, Process]:
        """Process of each term, by its label in `terms`."""
        return dict(zip(self.terms, self.processes, strict=True))

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Labels of all parameters, such as "GM[1].beta" and "WN.sigma2", in the order of the terms."""
        return tuple(f"{t}.{p.name}" for t, process in self.by_term.items() for p in process.parameters)

    @property
    def parameters(self) -> dict[str, float | None]:
        """Value of each parameter by label; None if it is to be estimated."""
        return {f"{t}.{k}": v for t, process in self.by_term.items() for k, v in process.values.items()}

    @property
    def structure(self) -> str:
        """Text of the model without values, such as "3*GM + WN"."""
        return _text(p.name for p in self.processes)

    def units(self, signal_unit: str = "u") -> dict[str, str]:
        """Unit of each parameter by label, for a signal in `signal_unit`; "" for a pure number.

        >>> Model.parse("GM + RW").units("rad/s")
        {'GM.beta': '1/s', 'GM.sigma2': '(rad/s)²', 'RW.gamma2': '(rad/s)² per sample'}
        """
        return {f"{t}.{p.name}": p.unit(signal_unit) for t, process in self.by_term.items() for p in process.parameters}

    @cached_property
    def fixed_names(self) -> frozenset[str]:
        """Labels of the fixed parameters."""
        return frozenset(
            f"{t}.{p.name}"
            for t, process in self.by_term.items()
            for p in process.parameters
            if process.is_fixed(p.name)
        )

    @cached_property
    def is_complete(self) -> bool:
        """Whether every parameter has a value."""
        return all(process.is_complete for process in self.processes)

    def with_values(self, values: Mapping[str, Value]) -> Model:
        """Return a copy with other values, by label. A fixed parameter stays fixed if its new value is a number.

        >>> from gmwm.processes import GM, fixed
        >>> (GM() + GM(beta=fixed(1.0))).with_values({"GM[2].beta": 3.0, "GM[2].sigma2": 0.5})
        Model('GM + GM(beta=fixed(3.0), sigma2=0.5)')
        """
        unknown = [label for label in values if label not in self.names]
        if unknown:
            raise ModelError(
                f"{self} has no parameter {unknown[0]!r}; its parameters are {', '.join(self.names)}",
                got=unknown[0],
                argument="values",
            )
        return Model(
            tuple(
                process.with_values(
                    **{p.name: values[f"{t}.{p.name}"] for p in process.parameters if f"{t}.{p.name}" in values}
                )
                for t, process in self.by_term.items()
            )
        )

    @property
    def held(self) -> Model:
        """A copy whose values are fixed."""
        return self.with_values({label: Fixed(value) for label, value in self.parameters.items() if value is not None})

    def sorted(self, rate: float) -> Model:
        """Return a copy with repeated terms in ascending order of correlation time; other terms stay in place."""
        rate, ordered = as_rate(rate), list(self.processes)
        for name in (name for name, count in Counter(p.name for p in ordered).items() if count > 1):
            at = [k for k, p in enumerate(ordered) if p.name == name]
            for k, process in zip(at, sorted((ordered[k] for k in at), key=lambda p: _order(p, rate)), strict=True):
                ordered[k] = process
        same = all(process is other for process, other in zip(ordered, self.processes, strict=True))
        return self if same else Model(tuple(ordered))

    def wavelet_variance(self, levels: int | ArrayLike, rate: float, filter: str | WaveletFilter = HAAR) -> Vector:
        """Compute the wavelet variance ν_j² (J,) of the sum in u², at scales of 2^j samples.

        >>> from gmwm.processes import RW, WN
        >>> (WN(sigma2=4.0) + RW(gamma2=1.0)).wavelet_variance(3, rate=100.0, filter="d4").round(4)
        array([2.1875, 1.2637, 0.9849])
        """
        return self._sum("wavelet_variance", lambda p: p.wavelet_variance(levels, rate, filter))

    def decomposition(
        self, levels: int | ArrayLike, rate: float, filter: str | WaveletFilter = HAAR
    ) -> dict[str, Vector]:
        """Compute the wavelet variance (J,) of each term in u², by label; their sum is `wavelet_variance`.

        The arguments and errors are the same as for `wavelet_variance`.

        >>> Model.parse("WN(sigma2=4) + RW(gamma2=1)").decomposition(3, rate=100.0)
        {'WN': array([2. , 1. , 0.5]), 'RW': array([0.25  , 0.375 , 0.6875])}
        """
        self._require_complete("decomposition")
        return {t: process.wavelet_variance(levels, rate, filter) for t, process in self.by_term.items()}

    def jacobian(
        self, levels: int | ArrayLike, rate: float, filter: str | WaveletFilter = HAAR,
        names: Sequence[str] | None = None,
    ) -> Matrix:  # fmt: skip
        """Compute the derivatives ∂ν_j²/∂θ (J, p) with respect to the p parameters `names`, by default all."""
        self._require_complete("Jacobian")
        rate, wavelet, columns = as_rate(rate), find_filter(filter), dict[str, Vector]()
        numbers, wanted = wavelet.numbers(levels), self.names if names is None else names
        for term, process in self.by_term.items():
            # power − 1 = 0 must give 1 for a value of 0 too, as 0**0 does.
            parameter = process.scale_parameter()
            factor = (power := parameter.scale_power or 1) * process.value(parameter.name) ** (power - 1)
            columns[f"{term}.{parameter.name}"] = factor * process.unit_shape(numbers, rate, wavelet)
            labels = [f"{term}.{p.name}" for p in process.nonlinear_parameters()]
            if any(label in wanted for label in labels):
                slopes = process.moments_jacobian(process.nonlinear.reshape(1, -1), numbers, rate, wavelet)[0]
                columns |= zip(labels, process.scale * slopes.T, strict=True)
        return np.column_stack([columns[name] for name in wanted])

    def running_sum_covariance(self, lags: ArrayLike, rate: float) -> Vector:
        """Compute the generalised covariance K(m) of the running sum (u²), up to a linear function; see `Process`."""
        return self._sum("running_sum_covariance", lambda p: p.running_sum_covariance(lags, rate))

    def allan_variance(self, clusters: ArrayLike, rate: float) -> Vector:
        """Compute the Allan variance (u²) of clusters of n samples, for any integer n ≥ 1.

        >>> from gmwm.processes import RW, WN
        >>> (WN(sigma2=4.0) + RW(gamma2=1.0)).allan_variance([1, 2, 3], rate=100.0).round(4)
        array([4.5   , 2.75  , 2.3889])
        """
        return self._sum("allan_variance", lambda p: p.allan_variance(clusters, rate))

    def autocovariance(self, lags: ArrayLike, rate: float) -> Vector:
        """Compute the autocovariance r(k) in u² at integer `lags`."""
        return self._sum("autocovariance", lambda p: p.autocovariance(lags, rate))

    def psd(self, frequencies: ArrayLike, rate: float) -> Vector:
        """Compute the two-sided power spectral density (u²/Hz) at |f| ≤ rate/2 (Hz)."""
        return self._sum("psd", lambda p: p.psd(frequencies, rate))

    def mean(self, t: ArrayLike) -> Vector:
        """Return the mean (u) at sample numbers t; only a drift has a mean other than 0."""
        return np.asarray(np.sum([p.mean(t) for p in self.processes], axis=0))

    def state_space(self, rate: float) -> StateSpace:
        """Return the state space of the sum in discrete time, in which each term has its own states.

        >>> from gmwm.processes import GM, RW, WN
        >>> model = GM(beta=1.0, sigma2=4.0) + RW(gamma2=0.01) + WN(sigma2=3.0)
        >>> space = model.state_space(rate=100.0)
        >>> np.diag(space.F).round(4), space.H, space.R
        (array([0.99, 1.  ]), array([[1., 1.]]), array([[3.]]))
        >>> model.state_terms(rate=100.0)
        ('GM', 'RW')
        """
        self._require("state_space")
        return StateSpace.sum(p.state_space(rate) for p in self.processes)

    def state_terms(self, rate: float) -> tuple[str, ...]:
        """Return, for each state of `state_space`, the label of the term to which it belongs; white noise has no
        state."""
        self._require("state_space")
        return tuple(t for t, process in self.by_term.items() for _ in range(process.state_space(rate).states))

    def continuous(self, rate: float) -> ContinuousStateSpace:
        """Return the state space of the sum in continuous time, in which each term has its own states.

        Its discretisation at `rate` is `state_space`. The attribute `left_out` lists the terms that have no form in
        continuous time, such as quantization noise.

        >>> Model.parse("GM(beta=0.5, sigma2=4.0) + QN(q2=1.0) + RW(gamma2=0.01)").continuous(rate=100.0).left_out
        ('QN',)
        """
        self._require("state_space")
        return ContinuousStateSpace.sum({t: process.continuous(rate) for t, process in self.by_term.items()})

    def has(self, theory: str) -> bool:
        """Return whether every term defines this theory; see `Process.has`."""
        return all(p.has(theory) for p in self.processes)

    def loglikelihood(self, data: Signal | ArrayLike, rate: float | None = None, *, mean: float | None = None) -> float:
        """Compute the exact Gaussian log-likelihood of a recording, by the Kalman filter.

            log p(x) = −½ [N log 2π + Σ log S_t + Σ v_t²/S_t]

        v_t are the innovations and S_t their variances. Unknown levels (the mean of the recording and the initial value
        of a random walk) have a flat prior and are integrated out, which equals an exact diffuse initialisation.

        `data`, `rate`, `mean` and the errors are the same as for `kalman_filter`.

        References
        ----------
        Durbin and Koopman (2012), Time Series Analysis by State Space Methods, 2nd ed., chapters 5 and 7.

        Examples
        --------
        >>> from gmwm.processes import WN
        >>> x = WN(sigma2=1.0).simulate(1000, 100.0, rng=1)
        >>> reference = -0.5 * (1000 * np.log(2 * np.pi) + x @ x)
        >>> bool(np.isclose(Model((WN(sigma2=1.0),)).loglikelihood(x, 100.0, mean=0.0), reference, rtol=1e-13))
        True
        """
        from gmwm.fitting.likelihood import loglikelihood

        return loglikelihood(self, data, rate, mean=mean)

    def simulate(self, n: int, rate: float, rng: np.random.Generator | int, paths: int | None = None) -> Vector:
        """Simulate Gaussian sample paths of the sum, an array (n,), or (paths, n) if `paths` is given.

        Stationary terms start in their stationary distribution.

        >>> model = Model.parse("WN(sigma2=4) + RW(gamma2=1)")
        >>> model.simulate(1000, rate=100.0, rng=1, paths=3).shape
        (3, 1000)
        """
        terms = self._paths(n, rate, rng, paths)
        total = np.zeros(shape_of_paths(n, paths))
        # Terms are added in the order of drawing, so that rounding does not depend on the order of the terms.
        for _, path in terms:
            total += path
        return total

    def simulate_terms(
        self, n: int, rate: float, rng: np.random.Generator | int, paths: int | None = None
    ) -> dict[str, NDArray[np.float64]]:
        """Simulate each term separately, by label; with the same seed, their sum is the result of `simulate`.

        >>> from gmwm.processes import RW, WN
        >>> terms = (WN(sigma2=1.0) + RW(gamma2=0.01)).simulate_terms(1000, rate=100.0, rng=1)
        >>> {label: path.shape for label, path in terms.items()}
        {'WN': (1000,), 'RW': (1000,)}
        """
        by_label = dict(self._paths(n, rate, rng, paths))
        return {label: by_label[label] for label in self.terms}

    def _paths(
        self, n: int, rate: float, rng: np.random.Generator | int, paths: int | None
    ) -> Iterator[tuple[str, NDArray[np.float64]]]:
        self._require("simulate")
        as_paths(n, paths)
        generator, rate, by_label = as_rng(rng), as_rate(rate), self.by_term
        return ((t, by_label[t].simulate(n, rate, generator, paths)) for t in self.drawing_order())

    def drawing_order(self) -> list[str]:
        """Return the labels in the order in which `simulate` draws the terms, sorted by the text of each term."""
        return [label for _, label in sorted((str(p), t) for t, p in self.by_term.items())]

    def __add__(self, other: Process | Model) -> Model:
        if not isinstance(other, (Process, Model, type)):
            return NotImplemented
        # Model raises the error if a class is given instead of a process.
        added = other.processes if isinstance(other, Model) else (other,)
        return Model((*self.processes, *added))

    def __mul__(self, count: int) -> Model:
        if isinstance(count, bool) or not isinstance(count, (int, np.integer)) or not 1 <= count <= MOST_TERMS:
            raise ModelError(
                f"a process must be repeated a whole number of times, from 1 to {MOST_TERMS}; got {count!r}",
                got=count,
                argument="count",
            )
        return Model(self.processes * int(count))

    __rmul__ = __mul__

    def __radd__(self, other: int) -> Model:
        # sum() begins with 0.
        return self if isinstance(other, int) and other == 0 else NotImplemented

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Model):
            return NotImplemented
        return self._multiset == other._multiset

    def __hash__(self) -> int:
        return hash(frozenset(self._multiset.items()))

    @cached_property
    def _multiset(self) -> Counter[Process]:
        return Counter(self.processes)

    @cached_property
    def _written(self) -> str:
        return _text(str(p) for p in self.processes)

    def __str__(self) -> str:
        return self._written

    def __repr__(self) -> str:
        return f"Model({str(self)!r})"

    def _sum(self, theory: str, of: Callable[[Process], Vector]) -> Vector:
        self._require(theory)
        return np.asarray(sum(of(p) for p in self.processes), dtype=np.float64)

    def _require(self, theory: str) -> None:
        self._require_complete(theory.replace("_", " "))
        lacking = [p for p in self.processes if not p.has(theory)]
        if lacking:
            others = [str(p) for p in self.processes if p not in lacking]
            error = lacking[0].missing(theory)
            if others:
                error.advice += " All other terms define it: use `{rest}`."
                error.facts["rest"] = " + ".join(others)
            raise error

    def _require_complete(self, what: str) -> None:
        if not self.is_complete:
            missing = [label for label, value in self.parameters.items() if value is None]
            raise ModelError(
                f"the {what} of {self} needs a value for {', '.join(missing)}",
                advice="Give the values in the model, or fit the model to data.",
                missing=tuple(missing),
            )


write_as_text(Model, Model.parse)

ModelLike = Model | Process | str  # types that are accepted as a model


def as_model(model: Any, name: str = "model") -> Model:
    """Convert a model, a single process, the text of a sum, or a result with a `model` to a Model."""
    if isinstance(model, Model):
        return model
    if isinstance(model, Process):
        return Model((model,))
    if isinstance(model, str):
        return Model.parse(model)
    if isinstance(fitted := getattr(model, "model", None), Model):  # a Fit, or the calibration of an axis
        return fitted
    raise _no_model(model, f'{name} must be a sum of processes, such as "2*GM + WN"', name)


def _no_model(got: object, message: str, argument: str) -> ModelError:
    message = f"{message}; got {got!r}"
    if isinstance(got, type) and issubclass(got, Process):
        return ModelError(message, argument=argument, got=got, advice="Write `{term}`.", term=f"{got.name}()")
    return ModelError(message, argument=argument, got=got)


def _text(terms: Iterable[str]) -> str:
    runs = ((term, len(list(same))) for term, same in groupby(terms))
    return " + ".join(f"{count}*{term}" if count > 1 else term for term, count in runs)


def _order(process: Process, rate: float) -> tuple[float, ...]:
    """Return the key that sorts terms: the correlation time, or inf if it is unknown, and the nonlinear parameters."""
    time, values = process.correlation_time(rate), process.values
    shape = [values[p.name] for p in process.nonlinear_parameters()]
    return (math.inf if time is None else time, *(math.inf if value is None else value for value in shape))
