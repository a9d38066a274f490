"""The main job: from the recording of a unit to a noise model, its numbers and its verdicts for every axis."""

from __future__ import annotations

import math
import os
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

from gmwm._threads import in_threads
from gmwm.calibration.findings import WANTED
from gmwm.calibration.misfit import line_in
from gmwm.calibration.options import WITHIN, CalibrationOptions
from gmwm.calibration.recording_info import Recording
from gmwm.calibration.result import AxisCalibration, Calibration
from gmwm.calibration.stream_measurement import measured_and_seen
from gmwm.datasheets import datasheet
from gmwm.errors import DataError, GmwmError, MissingTheoryError, ModelError, OptionError
from gmwm.estimation.estimator import as_fit
from gmwm.estimation.result import Fit
from gmwm.estimation.reweighting import settle
from gmwm.inference.goodness import GoodnessOfFit
from gmwm.inference.planning import SEEN, relative_errors
from gmwm.inspection import Inspection, inspect
from gmwm.options import as_whole_number
from gmwm.outliers import Verdict, contamination
from gmwm.processes.model import Model, ModelLike
from gmwm.processes.validation import as_seed
from gmwm.readers.streams import Stream
from gmwm.remarks import Remark
from gmwm.selection.api import select_within
from gmwm.signals import Imu, Signal, sensor_of
from gmwm.units import SI_UNIT, find_unit
from gmwm.variance.api import signal_wavelet_variance
from gmwm.variance.result import WaveletVariance

STAGES = ("measured", "model chosen", "fitted", "judged")
"""The steps of one axis, as `progress` tells them."""
LONGER = 10
"""Doublings of the recording that are looked at for it."""

if TYPE_CHECKING:
    from distributed import Client

Progress = Callable[[int, int, str], None]
"""Called with the number of steps done, that of all, and what was done."""


class Pair(NamedTuple):
    """The classical and the robust curve of one axis."""

    classical: WaveletVariance
    robust: WaveletVariance

    @property
    def unit(self) -> str:
        """That of the axis."""
        return self.classical.unit


Measured = Signal | WaveletVariance | Pair


def calibrate(
    data: Imu | Signal | Stream | Mapping[str, Measured],
    within: ModelLike = WITHIN,
    *,
    robust: Literal["auto"] | bool = "auto",
    weighting: Literal["diagonal", "optimal"] = "optimal",
    criterion: Literal["asymptotic", "bootstrap"] = "asymptotic",
    confidence: float = 0.95,
    efficiency: float = 0.6,
    draws: int = 1000,
    rng: int | np.random.Generator = 0,
    axes: str | Sequence[str] | None = None,
    threads: int | None = None,
    scheduler: str | Client | None = None,
    workers: int | None = None,
    progress: Progress | None = None,
) -> Calibration:
    """Find the noise model of every axis of a unit, and its numbers.

    For each axis: the wavelet variance, classical or robust; the model that `select` recommends within the general
    one; its fit with weights of its own and a certificate; intervals, test, and the numbers of datasheets. Axes are
    worked at side by side; one that cannot be used is reported in `failed`, and the others are not lost.

    Parameters
    ----------
    data : Imu, Signal, Stream, or mapping of axis to Signal, WaveletVariance or Pair
        A recording at rest, as `gmwm.read` gives it; or as `gmwm.stream` does, which is read twice, in bounded memory.
    within : Model, Process or str
        The largest model; all its parts are compared.
    robust : "auto", False or True
        Classical unless outliers show: a test at 5 % for all axes together (see `contamination`); or never; or always.
        A WaveletVariance is what it is. "auto" takes the classical one too where `within` has a sinusoid, whose robust
        variance is not that of its theory.
    weighting, criterion, draws, rng
        As for `select`. The settings record the integer seed, of a Generator the one drawn from it.
    confidence : float
        Level of the intervals, and of what `select` takes for equivalent.
    efficiency : float
        Of the robust wavelet variance under Gaussian noise.
    axes : str or sequence of str, optional
        Those to be calibrated, "gyro" for all of that sensor; all by default.
    threads : int, optional
        Axes at a time; as many as there are processors by default.
    scheduler, workers : optional
        Who reads a stream, a part each: a Dask scheduler (its address or a client), or a number of processes begun
        here. The rest of the work is done in this process.
    progress : function of (done, all, text), optional
        Called after each step, from one thread at a time; while a stream is read also within a step.

    Returns
    -------
    Calibration
        A mapping of axis to the recommended Fit, with its rankings, datasheets and verdicts, `.summary()`, `.plot()`,
        `.save()` and `.load()`.

    Raises
    ------
    OptionError
        If an option is not one of those it may be.
    DataError, ModelError
        If no axis can be calibrated.

    Examples
    --------
    >>> from gmwm import simulate
    >>> imu = simulate({"gyro_x": "WN(sigma2=4e-7) + RW(gamma2=1e-11)"}, rate=100.0, samples=100_000, rng=1)
    >>> calibration = calibrate(imu, within="GM + WN + RW")
    >>> calibration["gyro_x"].model.structure
    'WN + RW'
    """
    options = CalibrationOptions(
        within=within,
        robust=robust,
        weighting=weighting,
        criterion=criterion,
        confidence=confidence,
        efficiency=efficiency,
        draws=draws,
        seed=as_seed(rng),
        axes=axes,
    )
    return calibrate_recording(data, options, threads=threads, scheduler=scheduler, workers=workers, progress=progress)


def calibrate_recording(
    data: Imu | Signal | Stream | Mapping[str, Measured],
    options: CalibrationOptions,
    *,
    threads: int | None = None,
    scheduler: str | Client | None = None,
    workers: int | None = None,
    progress: Progress | None = None,
) -> Calibration:
    """The calibration of a recording, as `calibrate` gives it, by options that are checked."""
    if threads is not None:
        as_whole_number(threads, "threads", 1)
    chosen = _chosen(data, options.wanted)
    told = _Told(len(chosen) * len(STAGES), progress)
    items, looked = _looked_at(
        data, chosen, options=options, threads=threads, scheduler=scheduler, workers=workers, told=told
    )
    seen = () if looked is None else tuple(_handled(remark, options) for remark in looked.remarks)

    def work(axis: str, item: Measured) -> AxisCalibration | GmwmError:
        try:
            return _Axis(name=axis, item=item, options=options, together=len(items), told=told).calibrated()
        except OptionError:
            raise
        except GmwmError as error:
            return error

    try:
        found = in_threads(work, items, threads=threads)
    except BaseException:
        told.stop()
        raise
    done = {axis: one for axis, one in found.items() if isinstance(one, AxisCalibration)}
    failed = {axis: one for axis, one in found.items() if isinstance(one, GmwmError)}
    if not done:
        axis, error = next(iter(failed.items()))
        raise type(error)(f"no axis can be calibrated; {axis}: {error}") from error
    source = data.source if isinstance(data, Imu | Stream) else ""
    reasons = {axis: str(error) for axis, error in failed.items()}
    recording = None if looked is None else Recording.of(looked)
    return Calibration(
        axes=done, failed=reasons, settings=options, source=source, recording_remarks=seen, recording=recording
    )


def _handled(remark: Remark, options: CalibrationOptions) -> Remark:
    """The remark about knocks says what the calibration does about them."""
    if remark.code != "knocks":
        return remark
    handled = {"auto": "auto", True: "robust", False: "classical"}[options.robust]
    if options.robust == "auto" and line_in(options.general) is not None:
        handled = "line"
    return Remark.of(remark.code, remark.subject, **{**remark.facts, "handled": handled})


def _looked_at(
    data: Any,
    chosen: Mapping[str, Measured | None],
    options: CalibrationOptions,
    threads: int | None,
    scheduler: str | Client | None,
    workers: int | None,
    told: _Told,
) -> tuple[dict[str, Measured], Inspection | None]:
    """What is to be calibrated, measured already if it comes from a stream; and what a recording looks like."""
    if isinstance(data, Stream):
        curves, looked = measured_and_seen(
            data, tuple(chosen), efficiency=options.efficiency, threads=threads, scheduler=scheduler, workers=workers,
            done=told.read,
        )  # fmt: skip
        return {axis: Pair(*pair) for axis, pair in curves.items()}, looked
    if scheduler is not None or workers is not None:
        raise OptionError("scheduler= and workers= read a stream: pass calibrate(gmwm.stream(path), …)")
    items = {axis: item for axis, item in chosen.items() if item is not None}
    return items, inspect(data) if isinstance(data, Imu) else None


def _chosen(data: object, wanted: tuple[str, ...] | None) -> dict[str, Measured | None]:
    """What is to be calibrated, by axis; None of one that is still to be read."""
    items: dict[str, Measured | None]
    if isinstance(data, Signal):
        items = {data.axis or "signal": data}
    elif isinstance(data, Stream):
        items = dict.fromkeys(data.axes)
    elif isinstance(data, Imu):
        items = dict(data.signals)
    elif isinstance(data, Mapping) and data:
        items = dict(data)
    else:
        hint = "; read the file first: calibrate(gmwm.read(path))" if isinstance(data, str | os.PathLike) else ""
        if isinstance(data, np.ndarray | list | tuple):
            hint = "; say the rate and the unit of an array: calibrate(gmwm.Signal(x, rate, 'rad/s'))"
        raise OptionError(
            f"data must be an Imu, a Signal, a Stream, or a mapping of axis to Signal or WaveletVariance, got "
            f"{'an empty mapping' if isinstance(data, Mapping) else type(data).__name__}{hint}"
        )
    for axis, item in items.items():
        if not isinstance(item, Measured | None):
            raise OptionError(
                f"{axis} must be a Signal or a WaveletVariance, got {type(item).__name__}; an array becomes one by "
                "gmwm.Signal(x, rate, 'rad/s')"
            )
    unknown = [name for name in wanted or () if name not in items and name not in map(sensor_of, items)]
    if unknown:
        raise OptionError(f"axes must be some of {', '.join(items)}; got {unknown[0]}")
    chosen = {axis: item for axis, item in items.items() if not wanted or axis in wanted or sensor_of(axis) in wanted}
    for axis, item in chosen.items():
        if item is not None:
            _check_unit(axis, item.unit)
    return chosen


def _check_unit(axis: str, unit: str) -> None:
    """The name and the unit of an axis must not speak of two sensors."""
    known = find_unit(unit)
    named = next((quantity for quantity in SI_UNIT if sensor_of(axis) == quantity), None)
    if known is not None and named is not None and known.quantity != named:
        raise OptionError(
            f"{axis} must be in a unit of its sensor, as {SI_UNIT[named]}; it is in {unit}: give it another name, or "
            "mend its unit"
        )


class _Told:
    """Progress of several threads, told by one at a time; and the word to stop, heard between steps and candidates."""

    def __init__(self, steps: int, progress: Progress | None) -> None:
        self.steps, self.progress = steps, progress
        self.done = 0
        self.lock = threading.Lock()
        self.stopped = threading.Event()

    def stop(self) -> None:
        """Let no axis go on with its next step."""
        self.stopped.set()

    def listen(self) -> None:
        """End this thread's work where it is to stop."""
        if self.stopped.is_set():
            raise KeyboardInterrupt

    def read(self, text: str) -> None:
        """So much was read, before the first step."""
        if self.progress is not None:
            self.progress(self.done, self.steps, text)

    def step(self, axis: str, stage: str) -> None:
        """One step of an axis is done."""
        self.listen()
        with self.lock:
            self.done += 1
            if self.progress is not None:
                self.progress(self.done, self.steps, f"{axis}: {stage}")


@dataclass(frozen=True, kw_only=True)
class _Axis:
    """One axis on its way."""

    name: str
    item: Measured
    options: CalibrationOptions
    together: int
    told: _Told

    def calibrated(self) -> AxisCalibration:
        """From the signal to its numbers; `told` of each stage."""
        options, stages = self.options, iter(STAGES)
        wv, verdict = self._measured()
        if not np.any(wv.variance > 0):
            raise DataError("the signal is constant: it has no noise to model; is the axis connected?")
        self.told.step(self.name, next(stages))
        ranking = select_within(options.general, wv, options.ranking, progress=lambda *_: self.told.listen())
        self.told.step(self.name, next(stages))
        model = ranking.recommended.model
        # Remarks are in the fit; it raises no warning, because threads share the filters of Python's warnings.
        fit = as_fit(settle(model, wv, options.weighting, certify=True), wv, options.weighting)
        self.told.step(self.name, next(stages))
        level = options.confidence
        sheet = datasheet(fit, level)
        found = AxisCalibration(
            fit=fit,
            intervals=fit.confidence_intervals(level),
            test=_test(fit),
            datasheet=sheet,
            ranking=ranking,
            verdict=verdict,
            needed=needed(fit, options.weighting),
        )
        self.told.step(self.name, next(stages))
        return found

    def _measured(self) -> tuple[WaveletVariance, Verdict | None]:
        """The curve to be fitted, and whether outliers raise the classical one."""
        wanted, efficiency = self.options.robust, self.options.efficiency
        if isinstance(self.item, WaveletVariance):
            if wanted is True and not self.item.robust:
                raise DataError(
                    "robust=True, but its wavelet variance is classical; pass the signal, or robust='auto' or False"
                )
            return self.item, None
        if isinstance(self.item, Pair):
            classical, robust = self.item
        else:
            classical = signal_wavelet_variance(self.item)
            robust = signal_wavelet_variance(self.item, robust=True, efficiency=efficiency)
        verdict = contamination((classical, robust), comparisons=self.together)
        chosen = verdict.contaminated and line_in(self.options.general) is None if wanted == "auto" else wanted
        return (robust if chosen else classical), verdict


def _test(fit: Fit) -> GoodnessOfFit | None:
    try:
        return fit.goodness_of_fit()
    except (MissingTheoryError, ModelError):
        return None


def needed(fit: Fit, weighting: Literal["diagonal", "optimal"]) -> dict[str, float | None]:
    """How long a recording (s) would give 20 %, for each parameter with a standard error above 50 %.

    Doubled lengths are looked at; infinite where a thousand times the length does not do, None where a term acts as
    another one, which no length of theory can tell.
    """
    shares = zip(fit.sandwich.names, np.sqrt(np.diag(fit.sandwich.relative)).tolist(), strict=True)
    poor = [name for name, share in shares if share > SEEN]
    if not poor or fit.diagnostics.acts_as:
        return dict.fromkeys(poor)
    kept = [(term, p) for term, p in zip(fit.model.terms, fit.model.processes, strict=True) if p.scale > 0]
    model = Model(tuple(process for _, process in kept))
    label = {new: old for new, (old, _) in zip(model.terms, kept, strict=True)}
    found: dict[str, float | None] = dict.fromkeys(poor, math.inf)
    for doubling in range(1, LONGER + 1):
        samples = fit.wavelet_variance.samples << doubling
        names, errors = relative_errors(model, samples, fit.wavelet_variance.rate, weighting)
        for name, error in zip(names, errors.tolist(), strict=True):
            term, _, parameter = name.partition(".")
            own = f"{label[term]}.{parameter}"
            if found.get(own) == math.inf and error <= WANTED:
                found[own] = samples / fit.wavelet_variance.rate
        if math.inf not in found.values():
            break
    return found
