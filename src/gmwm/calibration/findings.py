"""Remarks on a calibration, and the verdict whether its numbers can be used."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gmwm.base.errors import MissingTheoryError
from gmwm.base.lazy import once_per_result
from gmwm.base.remarks import Fact, Quantity, Remark, Severity, gravest, sorted_remarks
from gmwm.base.statistics import holm
from gmwm.base.text import duration_text, gap_text
from gmwm.calibration.averaging import WALK, markov_instead_of_walk
from gmwm.calibration.misfit import in_any_recording, line_in, line_process, misfit_of, moves_white_noise
from gmwm.calibration.number_verdicts import MAIN, OF_FILTER, Usability, affected, counts
from gmwm.choosing.datasheets.effective import Use, true_times
from gmwm.choosing.datasheets.filter_numbers import filter_numbers, resonances_of
from gmwm.fitting.estimation.goodness import usable_levels
from gmwm.fitting.estimation.linearised import usable_in
from gmwm.fitting.estimation.model_error import implausible_levels
from gmwm.fitting.inference.planning import CERTAIN_ERROR
from gmwm.fitting.likelihood.system import is_ramp
from gmwm.measuring.covariance.design import Design
from gmwm.measuring.covariance.tails import UNKNOWN
from gmwm.measuring.outliers import Dependence, Replaced, excess_text
from gmwm.measuring.outliers.bursts import LONGEST
from gmwm.theory.filters import find_filter
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.noise import RW
from gmwm.theory.processes.oscillator import name_in_text

if TYPE_CHECKING:
    from gmwm.calibration.result import AxisCalibration, Calibration
    from gmwm.fitting.estimation.result import Fit
    from gmwm.measuring.spectrum import Line
    from gmwm.measuring.variance import WaveletVariance

TEST_SIZE = 0.05
"""Significance level of the goodness-of-fit tests of all axes together (docs/validation/goodness.md)."""
LEAST_SCALES_FOR_USE = 7
"""Scales from which numbers can be used; with fewer, one of two terms that cross at 16 samples is missed in over half
of the recordings (tests/calibration/test_short.py)."""
DEPENDENT = 1.1
"""Ratio of N at two efficiencies of the robust curve above which N cannot be used: in simulated disturbed recordings, N
was up to 6 % too small below it, and 10 to 70 % above it (tests/calibration/test_number_verdicts.py)."""
LEAST_LONGEST_SCALE_S = 2.0
"""Smallest longest usable scale (s) at which B and K can be used. Pinned by tests/calibration/test_short.py."""
LEAST_SCALES = 4
"""Scales for a calibration; with fewer, > 5 % of white noise gets another model (tests/calibration/test_short.py)."""
PLANNED_ERROR = 0.2
"""Relative standard error that the recommended recording lengths achieve (tests/calibration/test_calibrate.py)."""
RAISED_N = 1.05
"""Factor by which an oscillation raises N of the default filter from which a remark says so. The intervals of N are 1
to 8 % wide; the gyroscopes of an ADIS16405 have 1.03 at most (tests/calibration/test_spectrum.py)."""
CLOSE_MISFIT = 0.05
"""Relative misfit (levels with over 30 degrees of freedom) up to which rejected models are used; numbers, roots of
variances, have half of it (docs/validation/sensors.md)."""
LARGE_MISFIT = 1.5
"""Ratio of variances of a remark that the model does not describe the data (tests/calibration/test_misfit.py)."""

SMALL_OUTLIER_SHARE = 0.01
"""Share of N² that is due to wrong samples too small to be found, above which N is an upper limit, 0.5 % too large."""
_RAMP = "R"  # symbol of the rate ramp in a datasheet


def remarks_of(calibration: Calibration) -> list[Remark]:
    """Return all remarks on a calibration, the most severe first."""
    failed = [
        Remark.of("not-calibrated", axis, case="calibration", reason=why) for axis, why in calibration.failed.items()
    ]
    remarks = [*calibration.recording_remarks, *failed, *_of_recording(calibration)]
    remarks += equality_remarks(calibration)
    bad = set(rejected_axes(calibration))
    for axis, axis_calibration in calibration.axes.items():
        remarks += [
            *_of_axis(axis, axis_calibration, axis in bad, calibration),
            *(remark.about(axis) for remark in axis_calibration.remarks),
        ]
    return sorted_remarks(remarks)


def verdict_of(calibration: Calibration) -> Remark:
    """Return the verdict of the calibration, which counts the axes whose N, K and B can be used."""
    verdicts = calibration.number_verdicts
    axes = len(verdicts)
    lost = unusable(calibration)
    if len(lost) == axes:
        return Remark.of("verdict", case="unusable", axes=axes, one="yes" if axes == 1 else "no")
    of_symbol = {symbol: counts(verdicts, symbol) for symbol in MAIN}
    facts: dict[str, Fact] = {"axes": axes, **{f"{symbol}_use": use for symbol, (use, _) in of_symbol.items()}}
    facts["limits"] = tuple(f"{symbol} on {limit}" for symbol, (_, limit) in of_symbol.items() if limit) or ("none",)
    main = [verdict for of_axis in verdicts.values() for symbol, verdict in of_axis.items() if symbol in MAIN]
    reasons = {verdict.reason.code: verdict.reason.message.cause for verdict in main if verdict.reason is not None}
    facts |= {"why": "yes" if reasons else "no", "reasons": tuple(reasons), "causes": tuple(reasons.values())}
    if lost:
        return Remark.of("verdict", case="partly", names=tuple(lost), unusable=len(lost), **facts)
    refused = {verdict.symbol for verdict in main if verdict.usability is Usability.DO_NOT_USE}
    if refused.intersection(OF_FILTER):
        return Remark.of("verdict", case="wrong", **facts)
    worst = gravest(calibration.remarks)
    clean = not refused and not reasons and (worst is None or worst is Severity.INFO)
    return Remark.of("verdict", case="clean" if clean else "usable", **facts)


def unusable(calibration: Calibration) -> list[str]:
    """Return the axes none of whose main numbers can be used."""
    return [
        axis
        for axis, of_axis in calibration.number_verdicts.items()
        if all(of_axis[symbol].usability is Usability.DO_NOT_USE for symbol in MAIN if symbol in of_axis)
    ]


def rejected_axes(calibration: Calibration) -> list[str]:
    """Return the axes whose recommended model is rejected by a goodness-of-fit test at the 5 % level for all axes."""
    tests = {
        axis: axis_calibration.test
        for axis, axis_calibration in calibration.axes.items()
        if axis_calibration.test is not None
    }
    return [axis for axis, test in tests.items() if test.pvalue < TEST_SIZE / len(tests)]


def certificate_of(fits: Collection[Fit]) -> Remark | None:
    """Return the remark on what the certificates of fits cover; None if a fit has no certificate."""
    gaps = [fit.gap for fit in fits]
    certified = [gap for gap in gaps if gap is not None]
    if len(certified) < len(gaps):
        return None
    held = any(fit.model.fixed_names for fit in fits)
    return Remark.of("check-passed", case="optimum", gap=gap_text(max(certified)), of="shape" if held else "all")


def _of_recording(calibration: Calibration) -> Iterator[Remark]:
    """Yield remarks on the longest usable scale, and on recordings that are too short for a goodness-of-fit test."""
    shapes: dict[tuple[int, float], dict[str, WaveletVariance]] = {}
    for axis, axis_calibration in calibration.axes.items():
        wv = axis_calibration.fit.wavelet_variance
        shapes.setdefault((wv.samples, wv.rate), {})[axis] = wv
    for alike in shapes.values():
        longest = _longest_scale(next(iter(alike.values())))
        yield from [longest] if len(shapes) == 1 else [longest.about(axis) for axis in alike]
    if all(axis_calibration.test is None for axis_calibration in calibration.axes.values()):
        yield Remark.of("no-test")


def equality_remarks(calibration: Calibration) -> list[Remark]:
    """Return a remark for each axis on whether its recordings agree, with p-values adjusted by Holm's method."""
    comparisons = {axis: comparison.replicates for axis, comparison in calibration.axes.items()}
    several = {axis: comparison for axis, comparison in comparisons.items() if comparison is not None}
    pvalues = holm([comparison.pvalue for comparison in several.values()]).tolist() if several else []
    return [comparison.remark(p).about(axis) for (axis, comparison), p in zip(several.items(), pvalues, strict=True)]


def _of_axis(
    axis: str, axis_calibration: AxisCalibration, is_rejected: bool, calibration: Calibration
) -> Iterator[Remark]:
    wv = axis_calibration.fit.wavelet_variance
    scales = int(np.count_nonzero(usable_levels(wv)))
    if scales < LEAST_SCALES_FOR_USE:
        yield Remark.of(
            "too-short", axis, case="scales", least=LEAST_SCALES_FOR_USE, scales=scales, numbers=("all numbers",)
        )
    elif (longest := float(wv.tau[usable_levels(wv)][-1])) < LEAST_LONGEST_SCALE_S:
        yield Remark.of("too-short", axis, case="seconds", scale=Quantity(longest, "s"), numbers=("B", "K", "R"))
    if is_rejected:
        yield _rejection(axis, axis_calibration)
    yield from _of_coarse_levels(axis, axis_calibration)
    yield from _of_outliers(axis, axis_calibration, calibration)
    ramp = axis_calibration.datasheet.get(_RAMP)
    if ramp is not None and ramp.value:
        numbers = (WALK,) if _is_raised_by_ramp(axis_calibration) else ()
        value, _, high, unit = ramp.in_units("datasheet")
        if not ramp.upper_only:
            yield Remark.of("drift", axis, case="drift", rate=Quantity(value, unit), numbers=numbers)
        elif numbers and high is not None:
            yield Remark.of("drift", axis, case="possible", rate=Quantity(high, unit), numbers=numbers)
    yield from oscillations_in_n(axis, axis_calibration.fit)
    yield from spectrum_remarks(axis, axis_calibration)
    time = markov_instead_of_walk(axis_calibration.datasheet, axis_calibration.ranking)
    if time is not None:
        yield Remark.of("walk-or-markov", axis, case="equivalent", time=Quantity(time, "s"))
    if (time := _end_of_claim(axis_calibration)) < math.inf:
        yield Remark.of("walk-or-markov", axis, case="claim", time=Quantity(time, "s"))
    if axis_calibration.needed:
        yield _poorly_known(axis, axis_calibration)


def _is_raised_by_ramp(found: AxisCalibration) -> bool:
    """Return whether the ramp, which is that of one recording, raises K by more than the error of K."""
    walk, processes, rate = found.datasheet.get(WALK), found.fit.model.processes, found.fit.wavelet_variance.rate
    if walk is None or not walk.value or not walk.high:
        return False
    without = filter_numbers([process for process in processes if not is_ramp(process, rate)], rate).K
    return without / walk.value < filter_numbers(processes, rate).K / walk.high


def _end_of_claim(found: AxisCalibration) -> float:
    """Return the time (s) up to which a filter's stated error is true, or infinity; the fit keeps what it takes."""
    white, walk = (found.datasheet.get(symbol) for symbol in OF_FILTER)
    if white is None or walk is None or white.upper_only or walk.upper_only:
        return math.inf
    return true_times([found.fit], white.value, walk.value)[1]


def prepare_remarks(axis: str, found: AxisCalibration) -> None:
    """Compute what takes long of the remarks on an axis, where axes are processed in parallel; the fit keeps it."""
    _ = oscillations_in_n(axis, found.fit), _end_of_claim(found)


def _rejection(axis: str, axis_calibration: AxisCalibration) -> Remark:
    """Return the remark on a rejected model, which depends on its largest distance from the data."""
    misfit = axis_calibration.misfit
    if misfit is not None and misfit.largest <= CLOSE_MISFIT:
        return Remark.of("model-close", axis, largest=100 * misfit.largest, error=100 * axis_calibration.model_error)
    sinusoid = line_process()
    has_line = "yes" if sinusoid is None or line_in(axis_calibration.fit.model) is not None else "no"
    far = misfit_of(axis_calibration)
    if far is None or far.times <= LARGE_MISFIT:
        limit = moves_white_noise(axis_calibration)
        return Remark.of(
            "model-rejected", axis, case="calibration", line=has_line, sinusoid=sinusoid or "",
            limit="yes" if limit else "no", numbers=OF_FILTER[:1] if limit else (),
        )  # fmt: skip
    side = "above" if far.ratio > 1 else "below"
    numbers: tuple[str, ...] = ("the numbers of this axis",)
    if far.numbers:
        numbers = affected(far.numbers, far.tau, axis_calibration.datasheet) or ("B",)
    return Remark.of(
        "model-misfit", axis, tau=Quantity(far.tau, "s"), ratio=far.times, side=side, numbers=numbers, line=has_line,
        sinusoid=sinusoid or "",
    )  # fmt: skip


def _of_coarse_levels(axis: str, axis_calibration: AxisCalibration) -> Iterator[Remark]:
    """Yield a remark if the model is farther from the data at the coarsest scales than chance explains."""
    fit, wv = axis_calibration.fit, axis_calibration.fit.wavelet_variance
    if axis_calibration.misfit is None:
        return
    distance = np.log(np.maximum(fit.implied, 1e-300) / wv.variance)
    # A ramp has no scatter, so that any distance from it is implausible, even one that does not matter.
    far = implausible_levels(fit) & in_any_recording(axis_calibration, implausible_levels)
    far &= np.abs(distance) > CLOSE_MISFIT
    if not np.any(far) or _is_within_limit(axis_calibration, far):
        return
    below = far & (distance < 0)
    worst = int(np.argmax(np.where(below if np.any(below) else far, np.abs(distance), 0.0)))
    tau = float(wv.tau[worst])
    numbers = affected(("K", "B"), tau, axis_calibration.datasheet)
    # Slow noise that the data do not have makes numbers too large, not too small.
    named: dict[str, Fact] = {"case": "above", "limits": numbers}
    if np.any(below):
        named = {"case": "below", "numbers": (*numbers, "slow terms")}
    yield Remark.of("coarse-misfit", axis, tau=Quantity(tau, "s"), ratio=math.exp(abs(distance[worst])), **named)


def _is_within_limit(axis_calibration: AxisCalibration, levels: NDArray[np.bool_]) -> bool:
    """Return whether K is an upper limit that explains the data at these levels, so that the numbers are true."""
    fit, walk = axis_calibration.fit, axis_calibration.datasheet.get("K")
    if walk is None or not walk.upper_only or walk.high is None or not math.isfinite(walk.high):
        return False
    wv = fit.wavelet_variance
    largest = RW(gamma2=walk.high**2 / wv.rate).wavelet_variance(wv.levels, wv.rate, wv.filter)
    return bool(np.all(((fit.implied < wv.variance) & (fit.implied + largest >= wv.variance))[levels]))


def _up_to(tau: float) -> tuple[str, ...]:
    """Return the numbers that variance of a scale `tau` (s) affects."""
    return ("N", "K", "B", "R", "q_c")[int(tau > LONGEST) :]


def _of_outliers(axis: str, axis_calibration: AxisCalibration, calibration: Calibration) -> Iterator[Remark]:
    verdict = axis_calibration.verdict
    if verdict is None:
        return
    if not np.any(verdict.tested):
        yield Remark.of("outliers-not-tested", axis, case="fit", reason=verdict.reason)
    yield from _of_replaced(axis, verdict.replaced, axis_calibration)
    named = any(remark.code == "heavy-tails" and remark.subject == axis for remark in calibration.recording_remarks)
    excess = axis_calibration.fit.wavelet_variance.excess
    if excess is not None and excess.max() > UNKNOWN**2 / 2:
        yield Remark.of("heavy-tails", axis, case="infinite", numbers=("N",))
    elif not named and np.any(verdict.rising):
        taus = tuple(Quantity(float(tau), "s") for tau in verdict.tau[verdict.rising])
        yield Remark.of("outliers-found", axis, case="pulses", taus=taus, numbers=_up_to(taus[0].value))
    elif verdict.heavy_tailed and not axis_calibration.fit.wavelet_variance.robust and not named:
        yield Remark.of("heavy-tails", axis, case="fit")
    if not verdict.contaminated:
        return
    worst = int(np.argmax(np.where(verdict.exceeding, verdict.excess, -np.inf)))
    tau = Quantity(float(verdict.tau[worst]), "s")
    facts: dict[str, Fact] = {"excess": excess_text(float(verdict.excess[worst])), "tau": tau}
    if axis_calibration.fit.wavelet_variance.robust:
        yield Remark.of("outliers-left-out", axis, **facts)
        if verdict.dependence is not None:
            yield _dependence(axis, verdict.dependence, axis_calibration.fit.wavelet_variance.unit)
        if np.any(verdict.lighter):
            taus = tuple(Quantity(float(tau), "s") for tau in verdict.tau[verdict.lighter])
            yield Remark.of("robust-too-large", axis, case="above", taus=taus)
    else:
        # With robust="auto", the classical estimate is fitted only if the model has a sinusoid.
        yield Remark.of(
            "outliers-found", axis, case="fit", line="yes" if calibration.settings.robust == "auto" else "no", **facts
        )


def _dependence(axis: str, dependence: Dependence, unit: str) -> Remark:
    square = f"({unit})²" if unit else ""
    far = abs(math.log(dependence.other_value / dependence.value)) > 2 * math.log(DEPENDENT)
    return Remark.of(
        "robust-depends-on-efficiency", axis, case="far" if far else "near", tau=Quantity(dependence.tau, "s"),
        efficiency=dependence.efficiency, value=Quantity(dependence.value, square), other=dependence.other_efficiency,
        other_value=Quantity(dependence.other_value, square), numbers=_up_to(dependence.tau) if far else (),
    )  # fmt: skip


def _of_replaced(axis: str, replaced: Replaced, axis_calibration: AxisCalibration) -> Iterator[Remark]:
    wv, white = axis_calibration.fit.wavelet_variance, axis_calibration.datasheet.get("N")
    if white is not None and white.value > 0:
        share = replaced.left / wv.samples / (white.value**2 * wv.rate)
        percent = 100 * (1 - math.sqrt(max(1 - share, 0.0)))
        # The interval ends two standard errors from N. A bias of 0.3 of them adds 2 % to the 2.5 % above its end.
        ends = (white.low, white.high)
        error = min(0.0 if end is None else 50 * abs(end / white.value - 1) for end in ends)
        if share > SMALL_OUTLIER_SHARE and percent > 0.3 * error:
            yield Remark.of("outliers-found", axis, case="small", count=replaced.spikes, share=percent, numbers=("N",))
    if replaced.spikes:
        yield Remark.of("samples-replaced", axis, case="spikes", count=replaced.spikes, largest=replaced.largest)
    if replaced.knocks:
        yield Remark.of(
            "samples-replaced", axis, case="knocks", count=len(replaced.knocks),
            share=100 * replaced.in_knocks / wv.samples,
            first=Quantity(replaced.knocks[0][0], "s"),
        )  # fmt: skip


def _poorly_known(axis: str, axis_calibration: AxisCalibration) -> Remark:
    """Return the remark on parameters with large errors and lengths that reduce them; oscillations by frequency."""
    fit, needed = axis_calibration.fit, axis_calibration.needed
    lines = {
        f"{term}.{process.scale_parameter().name}": name_in_text(term, process)
        for term, process in fit.model.by_term.items()
        if process.oscillation() is not None
    }
    parameters = tuple(lines.get(name, name) for name in needed)
    seconds = sorted(math.inf if length is None else length for length in needed.values())
    first, last = ("no length" if math.isinf(length) else duration_text(length) for length in (seconds[0], seconds[-1]))
    return Remark.of(
        "poorly-known", axis, case="fit", parameters=parameters, seen=CERTAIN_ERROR, wanted=PLANNED_ERROR,
        lengths=first if first == last else f"{first} to {last}",
    )  # fmt: skip


def _longest_scale(wv: WaveletVariance) -> Remark:
    usable = wv.tau[usable_levels(wv)]
    longest = float(usable[-1] if usable.size else wv.tau[0])
    unbroken = _longest_unbroken(wv) if wv.segments else 0.0
    gaps = "several" if wv.recordings else "yes" if unbroken > longest else "no"
    return Remark.of(
        "longest-scale", duration=Quantity(wv.samples / wv.rate, "s"), scale=Quantity(longest, "s"), gaps=gaps,
        unbroken=Quantity(unbroken, "s"),
    )  # fmt: skip


def _longest_unbroken(wv: WaveletVariance) -> float:
    """Return the longest scale (s) that could be used if the recording had the same number of samples but no gaps."""
    levels = np.arange(1, wv.samples.bit_length())
    design = Design(levels, wv.samples, rate=wv.rate, filter=find_filter(wv.filter), transform=wv.transform)
    usable = levels[usable_in(design)]
    return float(2.0 ** usable[-1] / wv.rate) if usable.size else 0.0


def spectrum_remarks(axis: str, found: AxisCalibration) -> Iterator[Remark]:
    """Yield remarks on the lines and bumps in the spectrum of an axis, if it has a spectrum."""
    spectrum = found.spectrum
    if spectrum is None:
        return
    if lines := tuple(line for line in spectrum.lines if not _is_oscillation(line, found.fit)):
        yield _lines(axis, found, lines)
    peaks = [(bump.frequency, bump.width, bump.height) for bump in spectrum.bumps]
    peaks += (peak for peak in _oscillators(found.fit) if all(abs(peak[0] - f) > width for f, width, _ in peaks))
    rate = found.fit.wavelet_variance.rate
    # A slow oscillation of the model has its own remark, with other causes than a mount.
    slow = [process.oscillation() or 0.0 for process in found.fit.model.processes if not Use().contains(process, rate)]
    if peaks := [peak for peak in peaks if all(abs(peak[0] - f) > peak[1] for f in slow)]:
        frequencies, widths, heights = zip(*peaks, strict=True)
        yield Remark.of(
            "resonance-found", axis, frequencies=tuple(Quantity(frequency, "Hz") for frequency in frequencies),
            widths=tuple(Quantity(width, "Hz") for width in widths), heights=heights,
        )  # fmt: skip


def _oscillators(fit: Fit) -> Iterator[tuple[float, float, float]]:
    """Yield frequency, width and height above the other noise of each damped oscillator of a model that is as high."""
    rate = fit.wavelet_variance.rate
    # A ramp has no spectral density.
    noises = [process for process in fit.model.processes if process.line(rate) is None and process.has("psd")]
    for process in noises:
        peak = process.oscillation()
        if peak is None or not 0 < peak < rate / 2 or process.scale == 0:
            continue
        density = float(process.psd([peak], rate)[0])
        others = sum(float(other.psd([peak], rate)[0]) for other in noises)
        if "quality" in process.values and density > 0.5 * others:
            yield peak, peak / process.value("quality"), others / (others - density) if others > density else math.inf


def oscillations_in_n(axis: str, fit: Fit) -> list[Remark]:
    """Return a remark if oscillations or lines of the model raise N of the default filter by more than 5 %."""
    return once_per_result(fit, "oscillations in N", axis, lambda: list(_oscillations_in_n(axis, fit)))


def _oscillations_in_n(axis: str, fit: Fit) -> Iterator[Remark]:
    rate = fit.wavelet_variance.rate
    processes = [process for process in fit.model.processes if process.scale > 0 and Use().contains(process, rate)]
    oscillating = [process for process in processes if process.oscillation() is not None]
    if not oscillating:
        return
    shared = resonances_of(processes, rate)

    def without(left_out: Collection[Process]) -> float:
        return filter_numbers([p for p in processes if p not in left_out], rate, shared=shared).N

    try:
        density = without(())
    except MissingTheoryError:  # a process from another package without a spectral density
        return
    strong = [process for process in oscillating if density > RAISED_N * without((process,))]
    if strong:
        alone = without(strong)
        frequencies = sorted(process.oscillation() or 0.0 for process in strong)
        yield Remark.of(
            "lines", axis, case="inside", frequencies=tuple(Quantity(frequency, "Hz") for frequency in frequencies),
            factor=density / alone if alone > 0 else math.inf,
        )  # fmt: skip


def _is_oscillation(line: Line, fit: Fit) -> bool:
    """Return whether a line is one of an oscillation's many maxima: its density there is ≥ a tenth of the peak's."""
    rate = fit.wavelet_variance.rate
    for process in fit.model.processes:
        if (peak := process.oscillation()) is not None and process.line(rate) is None and peak < rate / 2:
            density = process.psd([line.frequency, peak], rate)
            if density[0] >= 0.1 * density[1]:
                return True
    return False


def _lines(axis: str, found: AxisCalibration, lines: tuple[Line, ...]) -> Remark:
    wv = found.fit.wavelet_variance
    strongest = sorted(lines, key=lambda line: -line.amplitude)
    share, tau = line_share(wv, lines)
    modelled = line_in(found.fit.model) is not None
    # 5 % of the wavelet variance at any level change a density such as N, the root of a variance, by 2.5 %.
    return Remark.of(
        "lines", axis, case="found" if share >= 0.05 and not modelled else "known",
        frequencies=tuple(Quantity(line.frequency, "Hz") for line in strongest),
        amplitudes=tuple(Quantity(line.amplitude, wv.unit) for line in strongest),
        widths=tuple(Quantity(line.width, "Hz") for line in strongest), share=share, tau=Quantity(tau, "s"),
        modelled="yes" if modelled else "no", sinusoid=line_process() or "",
    )  # fmt: skip


def line_share(wv: WaveletVariance, lines: tuple[Line, ...]) -> tuple[float, float]:
    """Return the largest share A² |H_j(f)|² / 2 of lines in a level, with squared gain |H_j|², and its scale (s)."""
    wavelet = find_filter(wv.filter)
    cycles = np.array([line.frequency for line in lines]) / wv.rate
    powers = np.array([line.amplitude for line in lines]) ** 2 / 2
    added = np.array([float(powers @ wavelet.squared_gain(cycles, int(level))) for level in wv.levels])
    share = np.divide(added, wv.variance, out=np.zeros(len(wv)), where=wv.variance > 0)
    worst = int(np.argmax(share))
    return min(float(share[worst]), 1.0), float(wv.tau[worst])
