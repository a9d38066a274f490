"""Bias instability from the minimum of the Allan deviation of a model."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Literal, TypeVar

import numpy as np

from gmwm.base.arrays import Integers, Matrix, Vector
from gmwm.base.errors import ModelError
from gmwm.base.lazy import once_per_result
from gmwm.base.remarks import Quantity, Remark
from gmwm.base.units import noise_unit
from gmwm.choosing.datasheets.entry import Entry
from gmwm.choosing.datasheets.limits import WIDEST_INTERVAL, allan_limit
from gmwm.fitting.estimation.intervals import upper_reach
from gmwm.fitting.estimation.linearised import COLLINEAR_SINGULAR_VALUE, columns_of, relative_jacobian
from gmwm.fitting.estimation.result import Fit
from gmwm.fitting.estimation.weighting import square_root
from gmwm.measuring.covariance import Design
from gmwm.measuring.variance.allan_regression import LAWS
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.model import Model

T = TypeVar("T", float, Vector)

_STEP = 0.01
"""Relative step of the differences of order 6 that approximate derivatives, with an error of about _STEP⁶ = 1e-12."""
UNBOUNDED_HALF_WIDTH = 300.0
"""Largest half width of an interval on a logarithmic scale, because e^300 is near the limit of double precision."""


@dataclass(frozen=True)
class FitCurve:
    """The p free parameters of a fit and their covariance `scatter`; `moving` has each with its process, by logarithm
    of the name, or the scale itself (None) of a term estimated as zero."""

    moving: tuple[tuple[Process, str | None], ...]
    scatter: Matrix
    design: Design
    root: Matrix  # (L, L), of the weighting matrix
    weighted: Matrix  # (L, p), derivatives of the wavelet variance, weighted with `root`

    @classmethod
    def of(cls, fit: Fit, *, sampling: bool = False) -> FitCurve:
        """Return parameters and covariance of a fit, with terms that act as others replaced; `sampling`: no spread."""
        return once_per_result(fit, "curve", sampling, lambda: cls._of(fit, sampling))

    @classmethod
    def _of(cls, fit: Fit, sampling: bool) -> FitCurve:
        sandwich = fit.sandwich.sampling if sampling else fit.sandwich
        design, model = Design.of(fit.wavelet_variance), fit.model
        processes = model.by_term
        names, _ = columns_of(model, {})
        unseen = [
            p.with_scale(1.0)
            for p in model.processes
            if p.scale == 0 and not p.is_fixed(p.scale_parameter().name) and p.shape_is_fixed
        ]
        columns = [p.wavelet_variance(design.levels, design.rate, design.filter) for p in unseen]
        root = square_root(fit.weighting_matrix)
        weighted = root @ np.column_stack([relative_jacobian(model, design, names), *columns])
        length = np.linalg.norm(weighted, axis=0)
        length[length == 0] = 1.0
        # The pseudoinverse leaves out directions in which the wavelet variance does not change.
        gain = (np.linalg.pinv(weighted / length, rcond=COLLINEAR_SINGULAR_VALUE) / length[:, None]) @ root
        split = (name.rpartition(".") for name in names)
        moving: list[tuple[Process, str | None]] = [(processes[term], name) for term, _, name in split]
        moving += [(process, None) for process in unseen]
        scatter = gain @ sandwich.wavelet @ gain.T
        return cls(tuple(moving), scatter, design=design, root=root, weighted=weighted)

    def without_lines(self) -> FitCurve:
        """Return the parameters and covariance without those of oscillations."""
        noises = [k for k, (process, _) in enumerate(self.moving) if process.oscillation() is None]
        moving, scatter = tuple(self.moving[k] for k in noises), self.scatter[np.ix_(noises, noises)]
        return replace(self, moving=moving, scatter=scatter, weighted=self.weighted[:, noises])

    def ends(self, z: float) -> Iterator[dict[Process, Process]]:
        """Yield processes at both ends of principal axes longer than a factor of two, where derivatives fail. An end is
        nearer if the variance changes there by over twice what its derivative says: the data exclude what is beyond."""
        free = [k for k, (_, name) in enumerate(self.moving) if name is not None]
        variances, axes = np.linalg.eigh(self.scatter[np.ix_(free, free)])
        here = self._variance(dict.fromkeys(self.moving[k][0] for k in free))
        for variance, axis in zip(variances, axes.T, strict=True):
            reach = min(z * math.sqrt(max(variance, 0.0)), math.log(WIDEST_INTERVAL))
            most = 2.0 * reach * float(np.linalg.norm(self.weighted[:, free] @ axis))
            for change in (-reach, reach):
                while abs(change) > math.log(2.0):
                    end = self._end(free, change * axis)
                    if end is not None and np.linalg.norm(self.root @ (self._variance(end.values()) - here)) <= most:
                        yield end
                        break
                    change *= 0.8

    def _end(self, free: Sequence[int], changes: Vector) -> dict[Process, Process] | None:
        """Return the processes with changed logarithms of the free parameters; None outside the range of one."""
        values: dict[Process, dict[str, float]] = {}
        for k, change in zip(free, changes, strict=True):
            process, name = self.moving[k]
            assert name is not None
            values.setdefault(process, {})[name] = process.value(name) * math.exp(change)
        with suppress(ModelError):
            return {process: process.with_values(**names) for process, names in values.items()}
        return None

    def _variance(self, processes: Iterable[Process]) -> Vector:
        """Return the wavelet variance (L,) of a sum of processes."""
        d = self.design
        return np.asarray(sum(p.wavelet_variance(d.levels, d.rate, d.filter) for p in processes))

    def slopes(self, sizes: Sequence[int]) -> Matrix:
        """Return the derivatives (p, n) of the Allan variance at numbers of samples (n,) by the parameters."""
        rate = self.design.rate
        rows = [sensitivity(p, name, lambda process: process.allan_variance(sizes, rate)) for p, name in self.moving]
        return np.array(rows).reshape(-1, len(sizes))

    def error(self, slopes: Vector) -> float:
        """Return the standard error of a quantity that has these derivatives (p,) with respect to the parameters."""
        return math.sqrt(max(float(slopes @ self.scatter @ slopes), 0.0))


def sensitivity(process: Process, name: str | None, of: Callable[[Process], T]) -> T:
    """Return ∂f/∂ ln θ for `name`: exact for scales, differences of order 6 for shapes; by the scale for None."""
    if name is None:
        return of(process)
    parameter = next(p for p in process.parameters if p.name == name)
    if parameter.scale_power is not None:
        return parameter.scale_power * of(process)
    at = process.value(name)
    place = [p.name for p in process.nonlinear_parameters()].index(name)
    room = float(process.room(process.nonlinear.reshape(1, -1))[0, place])

    def moved(distance: int) -> T:
        return of(process.with_values(**{name: at + distance * _STEP * room}))

    near, middle, far = (moved(distance) - moved(-distance) for distance in (1, 2, 3))
    return at / (60.0 * _STEP * room) * (45.0 * near - 9.0 * middle + far)


SYMBOL: Literal["B"] = "B"


def bias_instability(fit: Fit, z: float | None) -> tuple[Entry | None, Remark | None]:
    """Compute the bias instability B, or only a remark that says why it cannot be computed.

    B is the minimum of σ(τ) in the recording, over √(2 ln 2/π) (IEEE Std 952-1997, annex C), without sinusoids, whose
    zeros do not inform about noise. With A = σ²(τ) at the minimum, where τ has only a second-order effect,

        ∂ ln B/∂ ln θ = ½ ∂ ln A/∂ ln θ,

    and the interval is B exp(±z SE(ln B)), with terms estimated as zero; none if `z` is None.

    B is an upper limit if the curve falls at the last τ, rises from the first on, or not by z standard errors above its
    minimum. The limit is the larger of the interval's end, as a model may lack flicker noise, and the smallest upper
    limit of the measured σ(τ)/√(2 ln 2/π), as B is at most this. No end exceeds the largest upper limit of σ near its
    minimum."""
    wv = fit.wavelet_variance.without_lags
    noises = tuple(process for process in fit.model.processes if process.oscillation() is None)
    lines = tuple(process for process in fit.model.processes if process.oscillation() is not None)
    if not noises:
        return None, Remark.of("no-number", wv.axis, case="b", reason=f"{fit.model.structure} has no noise")
    model = Model(noises)
    last = 2 ** (int(wv.levels[-1]) - 1)
    unit, factor = noise_unit(0.0, wv.unit)
    factor /= LAWS[SYMBOL].factor
    n = lowest(lambda sizes: model.allan_variance(sizes, wv.rate), last)
    least = float(model.allan_variance([n], wv.rate)[0])
    if least == 0:
        return None, Remark.of("no-number", wv.axis, case="b", reason="all estimates of the model are zero")
    curve = None if z is None else FitCurve.of(fit).without_lines()
    judged = None if z is None else FitCurve.of(fit, sampling=True).without_lines()
    bounded = _bounded(model, n, last=last, rate=wv.rate, curve=judged, z=z)
    reached = {"tau": Quantity((1 if bounded == "rises" else last) / wv.rate, "s")}
    remark = None if bounded is None else Remark.of("b-limit", wv.axis, because=bounded, source="model", **reached)
    value = factor * math.sqrt(least)
    entry = Entry(
        symbol=SYMBOL, title=LAWS[SYMBOL].name, value=value, low=None, high=None, unit=unit, term=None,
        upper_only=remark is not None, tau=n / wv.rate,
    )  # fmt: skip
    if set(model.parameters) <= model.fixed_names:
        return replace(entry, low=value, high=value, held=True), remark
    if z is None or curve is None or judged is None:
        return entry, remark
    total, own = (0.5 * z * c.error(c.slopes([n])[:, 0]) / least for c in (curve, judged))
    below, above = (math.exp(min(d, UNBOUNDED_HALF_WIDTH)) for d in (total, upper_reach(total, own, 0.5)))
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = fit.model.allan_variance(np.left_shift(1, wv.levels - 1), wv.rate) / fit.model.wavelet_variance(
            wv.levels, wv.rate, wv.filter
        )
    high = max(value, min(value * above, factor * math.sqrt(allan_limit(wv, ratio))))
    if remark is None or bounded is None:
        return replace(entry, low=value / below, high=high), None
    measured = _of_data(wv, model, lines, n)
    if measured is not None and factor * measured > high:
        high = factor * measured
        remark = Remark.of("b-limit", wv.axis, because=bounded, source="data", **reached)
    return replace(entry, low=0.0, high=high), remark


def _of_data(wv: WaveletVariance, model: Model, lines: tuple[Process, ...], n: int) -> float | None:
    """Return the smallest upper limit of the measured Allan deviation without `lines`: the model's times the ratio of
    wavelet variances; None without levels near the minimum."""
    implied = model.wavelet_variance(wv.levels, wv.rate, wv.filter)
    added = sum((line.wavelet_variance(wv.levels, wv.rate, wv.filter) for line in lines), np.zeros(len(wv)))
    # A variance of zero is due to the coarse resolution of the output, so it gives no limit for the noise.
    seen = (wv.variance > 0) & (wv.upper > added) & (implied > 0)
    if not {n.bit_length(), (n - 1).bit_length() + 1} <= set(wv.levels[seen].tolist()):
        return None
    sizes = np.left_shift(1, wv.levels[seen] - 1)
    ours = model.allan_variance(sizes, wv.rate)
    high = np.sqrt(ours * (wv.upper[seen] - added[seen]) / implied[seen])
    return float(high.min())


def lowest(curve: Callable[[Integers], Vector], last: int) -> int:
    """Return the number of samples, from 1 to `last`, at which a curve with few extrema per octave has its minimum."""
    # 24 points per octave at first: the Allan variance of a sum of processes has few extrema per octave.
    count = 2 + math.ceil(24 * math.log2(last))
    sizes = np.unique(np.round(np.geomspace(1, last, count)).astype(np.int64))
    while True:
        k = int(np.argmin(curve(sizes)))
        low, high = int(sizes[max(k - 1, 0)]), int(sizes[min(k + 1, sizes.size - 1)])
        if high - low <= 2:
            return int(sizes[k])
        # The next points are whole numbers between the two neighbours of the lowest point.
        sizes = np.unique(np.linspace(low, high, min(32, high - low) + 1).astype(np.int64))


def _bounded(model: Model, n: int, last: int, rate: float, curve: FitCurve | None, z: float | None) -> str | None:
    """Return why the minimum gives only an upper limit: "falls", "rises" or "unsure"; None if it gives a value."""
    ends, least = model.allan_variance([1, last], rate), model.allan_variance([n], rate)[0]
    # On a flat curve (flicker noise), rounding errors decide n, and B is known without a rise
    # (tests/test_bias_limits.py).
    if ends.max() <= (1 + 1e-9) * least:
        return None
    if n == last:
        return "falls"
    if n == 1:
        return "rises"
    if z is None or curve is None:
        return None
    later = [2**k for k in range(n.bit_length(), last.bit_length())]
    rises = model.allan_variance(later, rate) - least
    here, *slopes = curve.slopes([n, *later]).T
    if not any(rise > z * curve.error(each - here) for each, rise in zip(slopes, rises, strict=True)):
        return "unsure"
    return None
