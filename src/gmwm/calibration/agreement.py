"""Compare several calibrations of one unit with each other, number by number, and with reference values."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from statistics import NormalDist
from typing import Any, TypeVar

import numpy as np

from gmwm.base.arrays import Matrix
from gmwm.base.errors import OptionError, UnitError
from gmwm.base.statistics import holm
from gmwm.base.units import sensor_of
from gmwm.calibration.agreement_result import Agreement, SensorFactors, SharedNumber
from gmwm.calibration.data import names_of
from gmwm.calibration.findings import rejected_axes
from gmwm.calibration.number_verdicts import Verdicts
from gmwm.calibration.result import Calibration
from gmwm.calibration.tables import in_order, merge_names
from gmwm.choosing.datasheets import Datasheet, Entry
from gmwm.choosing.datasheets.bias import SYMBOL as BIAS
from gmwm.choosing.selection.structure import slow_terms
from gmwm.files.importers.values import as_reference
from gmwm.measuring.variance.allan_regression import LAWS
from gmwm.recording.options import as_size
from gmwm.theory.processes.model import Model

_SLOW = ("R",)  # symbols of the datasheet numbers that depend on the slow terms of a model
_SIGNED = "R"
"""Symbol of the rate ramp, with sign and symmetric interval; the others are symmetric on a logarithmic scale."""

_SHARED = ("N", "K")  # symbols of the numbers that are also tested for all axes of a sensor together: those of a filter
_Z = NormalDist().inv_cdf(0.975)

Tested = TypeVar("Tested", SharedNumber, SensorFactors)
Recording = Calibration | Mapping[str, Datasheet]


def agree(
    calibrations: Sequence[Recording], *, size: float = 0.05, labels: Sequence[str] | None = None,
    reference: Mapping[str, tuple[float, str]] | None = None,
) -> Agreement:  # fmt: skip
    """Test which numbers of several calibrations of one unit differ by more than chance.

    Let x_r be the logarithm of a number in recording r of n (for the rate ramp R, the number itself), and s_r its
    standard error, which follows from the width of the confidence interval. If all recordings have the same value,

        Σ (x_r − x̄)²/s_r² ~ χ² with n − 1 degrees of freedom, where x̄ is the mean of x_r weighted by 1/s_r².

    If a recording gives only an upper limit, this limit is compared with the interval of each other recording: both
    are widened until they meet, and the p-value follows from the number of standard errors that this needs. The
    smallest p-value, multiplied by the number of comparisons, is used. All p-values are then adjusted by Holm's method,
    so `size` is the probability of any false alarm among all numbers.

    A change that all axes of a sensor share is clearer in all axes together. For N and K of each sensor, let x_ir be
    the logarithm in axis i and recording r, and m_i + d_r its expectation. The test that all d_r are equal compares the
    weighted sums of squares with and without d_r; exp(d_r − d_1) is the factor of recording r. If a calibration says
    that two axes share noise with a correlation ρ, the correlation of the errors of x is ρ². These tests are adjusted
    among themselves, so each family of tests has the level `size`.

    N, K, Q and B are always compared. R is compared only if all models have the same slow terms, and other numbers only
    if all recordings have the same model. B of a flicker term is not compared with B at the minimum of the Allan
    deviation. The intervals of calibrations include the uncertainty of the model choice.

    Parameters
    ----------
    calibrations : sequence of Calibration, or of mappings of axis to Datasheet
        One calibration for each recording; at least two.
    size : float
        Significance level of all tests together.
    labels : sequence of str, optional
        Names of the recordings. Default: the names of their files.
    reference : mapping of "gyro.N" or "gyro_x.N" to (value, unit), optional
        Values of the manufacturer for a sensor or an axis, with a datasheet unit, such as (2.0, "deg/√h").

    Returns
    -------
    Agreement
        The numbers of all recordings, with the test and the reference value of each.

    Raises
    ------
    OptionError
        If there are fewer than two calibrations, no axis is in two of them, or an option has an invalid value.
    UnitError
        If an axis has different units in the recordings, or a reference value has a wrong unit.

    References
    ----------
    Holm (1979), A simple sequentially rejective multiple test procedure, Scandinavian Journal of Statistics 6, 65-70.

    Examples
    --------
    >>> from gmwm import calibrate, simulate
    >>> truth = {"gyro_x": "WN(sigma2=4e-7) + RW(gamma2=1e-11)"}
    >>> imus = [simulate(truth, rate=100.0, samples=50_000, rng=seed) for seed in (1, 2)]
    >>> found = agree([calibrate(imu, within="WN + RW") for imu in imus], reference={"gyro.N": (0.22, "°/√h")})
    >>> found.disagreeing
    ()
    >>> [round(ratio, 1) for ratio in found["gyro_x.N"].ratios]
    [1.0, 1.0]
    """
    sheets = _sheets(calibrations)
    size = as_size(size)
    names = _labels(calibrations, labels)
    axes = merge_names([list(sheet) for sheet in sheets])
    if not any(sum(axis in sheet for sheet in sheets) > 1 for axis in axes):
        axes_of = {name: ", ".join(sheet) for name, sheet in zip(names, sheets, strict=True)}
        raise OptionError(argument="calibrations", expected="calibrations with an axis in common", got=axes_of)
    uses = [found.number_verdicts if isinstance(found, Calibration) else {} for found in calibrations]
    rows = _adjust([row for axis in axes for row in _of_axis(axis, sheets, uses, names)], size)
    rows, unmatched = _beside(rows, reference or {})
    models = {axis: tuple(sheet[axis].model if axis in sheet else None for sheet in sheets) for axis in axes}
    rejections = _where(  # intervals include the model error, if there is one
        calibrations, names, lambda found: [a for a in rejected_axes(found) if not found.axes[a].model_error]
    )
    failures = _where(calibrations, names, lambda found: found.failed)
    return Agreement(
        labels=names, rows=tuple(rows), models=models, rejected=rejections, size=float(size), unmatched=unmatched,
        failed=failures, sensors=tuple(_adjust(_of_sensors(rows, sheets, calibrations), size)),
    )  # fmt: skip


def _sheets(calibrations: Sequence[Recording]) -> list[Mapping[str, Datasheet]]:
    """Return the datasheets of each recording by axis, or raise an OptionError for a wrong argument."""
    if not isinstance(calibrations, list | tuple) or len(calibrations) < 2:
        got = len(calibrations) if isinstance(calibrations, list | tuple) else type(calibrations).__name__
        raise OptionError(argument="calibrations", expected="a list of at least two, one for each recording", got=got)
    sheets: list[Mapping[str, Datasheet]] = []
    for place, calibration in enumerate(calibrations, start=1):
        sheet = calibration.datasheets if isinstance(calibration, Calibration) else calibration
        if not isinstance(sheet, Mapping) or not sheet or not all(isinstance(s, Datasheet) for s in sheet.values()):
            raise OptionError(
                argument="calibrations", expected="a list of Calibrations, or of mappings of axis to Datasheet",
                got=f"{type(calibration).__name__} in place {place}",
            )  # fmt: skip
        sheets.append(sheet)
    return sheets


def _labels(calibrations: Sequence[Recording], labels: Sequence[str] | None) -> tuple[str, ...]:
    if labels is None:
        return names_of([item.source if isinstance(item, Calibration) else "" for item in calibrations])
    names = tuple(labels)
    if isinstance(labels, str) or not all(isinstance(name, str) and name for name in names):
        raise OptionError(argument="labels", expected="a sequence of names", got=labels)
    if len(names) != len(calibrations) or len(set(names)) != len(names):
        raise OptionError(argument="labels", expected=f"{len(calibrations)} different names", got=labels)
    return names


def _where(
    calibrations: Sequence[Recording], names: Sequence[str], of: Callable[[Calibration], Iterable[str]]
) -> dict[str, tuple[str, ...]]:
    """Return for each axis the names of those recordings for whose calibration `of` returns this axis."""
    recordings: dict[str, tuple[str, ...]] = {}
    for name, calibration in zip(names, calibrations, strict=True):
        for axis in of(calibration) if isinstance(calibration, Calibration) else ():
            recordings[axis] = (*recordings.get(axis, ()), name)
    return recordings


def _of_axis(
    axis: str, sheets: Sequence[Mapping[str, Datasheet]], uses: Sequence[Verdicts], names: Sequence[str]
) -> list[SharedNumber]:  # fmt: skip
    """Return the numbers of one axis, each with the p-value of its test, not adjusted for the number of tests."""
    axis_sheets = [sheet.get(axis) for sheet in sheets]
    units = {sheet.unit: name for sheet, name in zip(axis_sheets, names, strict=True) if sheet is not None}
    if len(units) > 1:
        raise UnitError(
            f"{axis} has different units: {', '.join(f'{unit} in {name}' for unit, name in units.items())}",
            advice="Calibrate again, and pass the units of the file without units with {--units}.",
        )
    rows = []
    for symbol in in_order([list(sheet) for sheet in axis_sheets if sheet is not None]):
        entries = tuple(None if sheet is None else sheet.get(symbol) for sheet in axis_sheets)
        pairs = [(e, s) for e, s in zip(entries, axis_sheets, strict=True) if e is not None and s is not None]
        first = pairs[0][0]
        alike = _alike(symbol, [s.model for s in axis_sheets if s is not None])
        frequencies = [entry.frequency for entry, _ in pairs if entry.frequency is not None]
        # Two peaks within a tenth of their frequency are the same one: a mount moves a resonance by less.
        alike = alike and (not frequencies or max(frequencies) < 1.1 * min(frequencies))
        row = SharedNumber(
            axis=axis, symbol=symbol, title=first.title, unit=first.unit, entries=entries,
            use=tuple(of[axis][symbol].usability.value if symbol in of.get(axis, ()) else None for of in uses),
        )  # fmt: skip
        intervals = sum(_is_known(entry) for entry, _ in pairs)
        usable = [
            (entry, _quantile(sheet)) for entry, sheet in zip(row.usable, axis_sheets, strict=True)
            if entry is not None and sheet is not None and _is_known(entry)
        ]  # fmt: skip
        kinds = {entry.term is None for entry, _ in pairs if symbol == BIAS}
        reason = "interval" if intervals < 2 else "use" if len(usable) < 2 else ""
        reason = "models" if not alike else "one recording" if len(pairs) < 2 else "kinds" if len(kinds) > 1 else reason
        pvalue = None if reason else _pvalue(usable, symbol == _SIGNED)
        rows.append(replace(row, pvalue=pvalue, reason=reason))
    return rows


def _quantile(sheet: Datasheet) -> float:
    """Return half the width of the intervals of a datasheet in standard errors."""
    return NormalDist().inv_cdf((1 + sheet.level) / 2)


def _alike(symbol: str, models: Sequence[str]) -> bool:
    """Return whether a number has the same meaning in all models. N and K of a filter depend on the spectrum only, and
    Q and B on the Allan deviation. R depends on the slow terms; others are parameters of one term."""
    if symbol not in LAWS:
        return len(set(models)) == 1
    return symbol not in _SLOW or len({slow_terms(Model.parse(model)) for model in models}) == 1


def _is_known(entry: Entry) -> bool:
    """Return whether a number was estimated and has a confidence interval or an upper limit."""
    if entry.held or entry.low is None or entry.high is None or not math.isfinite(entry.high):
        return False
    return entry.upper_only or entry.low < entry.value < entry.high


def _pvalue(known: Sequence[tuple[Entry, float]], signed: bool) -> float:
    """Return the p-value that entries, with half widths in standard errors, are equal; logarithms unless `signed`."""
    from scipy.special import gammaincc

    points = [_point(entry, z, signed) for entry, z in known if not entry.upper_only]
    limits = [(entry, z) for entry, z in known if entry.upper_only]
    tests = []
    if len(points) > 1:
        x, s = np.array(points).T
        # The weights are relative to the smallest error, so that none of them overflows.
        weights = (s.min() / s) ** 2
        centre = float(weights @ x / weights.sum())
        tests.append(float(gammaincc((len(points) - 1) / 2, float(np.sum(((x - centre) / s) ** 2)) / 2)))
    tests += [_below(entry, z, *point, signed) for entry, z in limits for point in points]
    return min(1.0, len(tests) * min(tests)) if tests else 1.0


def _point(entry: Entry, z: float, signed: bool) -> tuple[float, float]:
    """Return the logarithm of a number and its standard error. If the number is signed, no logarithm is taken."""
    low, high = entry.low or 0.0, entry.high or 0.0
    if signed:
        return entry.value, (high - low) / (2 * z)
    return math.log(entry.value), (math.log(high) - math.log(low)) / (2 * z)


def _below(limit: Entry, z: float, x: float, s: float, signed: bool) -> float:
    """Return the p-value of a limit against a larger x with error s: both intervals widen until they meet, an upper
    bound, as errors add by squares. Amplitudes widen by variance, Allan numbers by logarithm."""

    def apart(width: float) -> bool:
        value, high, share = abs(limit.value), limit.high or 0.0, width / z
        if signed:
            return value + share * (high - value) < abs(x) - width * s
        if limit.tau is not None:
            return math.log(value) + share * math.log(high / value) < x - width * s
        square = (value / high) ** 2
        return math.log(high) + 0.5 * math.log(max(square + share * (1 - square), 1e-300)) < x - width * s

    low, high = 0.0, 40.0  # beyond 40 standard errors, a normal p-value is zero in double precision
    if not apart(low):
        return 1.0
    while high - low > 1e-6:
        middle = (low + high) / 2
        low, high = (middle, high) if apart(middle) else (low, middle)
    return math.erfc(high / math.sqrt(2))


def _of_sensors(
    rows: Sequence[SharedNumber], sheets: Sequence[Mapping[str, Datasheet]], calibrations: Sequence[Recording]
) -> list[SensorFactors]:
    """Return the factors of N and K that all axes of a sensor share, with the p-values of their tests."""
    factors = []
    for sensor, symbol in dict.fromkeys((sensor_of(row.axis), row.symbol) for row in rows if row.symbol in _SHARED):
        logs: dict[str, list[tuple[float, float]]] = {}
        for row in rows:
            if (sensor_of(row.axis), row.symbol) != (sensor, symbol):
                continue
            points = [
                _point(entry, _quantile(sheet[row.axis]), signed=False)
                if entry is not None and _is_known(entry) and not entry.upper_only else (math.nan, math.nan)
                for entry, sheet in zip(row.usable, sheets, strict=True)
            ]  # fmt: skip
            if sum(math.isfinite(x) for x, _ in points) > 1:
                logs[row.axis] = points
        if len(logs) > 1:
            shared = [_error_correlations(calibration, list(logs)) for calibration in calibrations]
            factors.append(_shared_factors(sensor, symbol, logs, shared))
    return factors


def _error_correlations(calibration: Recording, axes: Sequence[str]) -> Matrix:
    """Return the correlations (A, A) of the errors of the logarithms of axes: the squares of those of their noise."""
    shared = np.eye(len(axes))
    for remark in calibration.recording_remarks if isinstance(calibration, Calibration) else ():
        facts: dict[str, Any] = dict(remark.facts)
        for pair, correlation in zip(facts.get("pairs", ()), facts.get("correlations", ()), strict=False):
            if set(pair.split("/")) <= set(axes):
                i, j = (axes.index(axis) for axis in pair.split("/"))
                shared[i, j] = shared[j, i] = correlation**2
    # The largest correlations of several scales together need not be a correlation matrix.
    excess = max(0.0, 0.01 - float(np.linalg.eigvalsh(shared)[0]))
    return np.asarray((shared + excess * np.eye(len(axes))) / (1 + excess))


def _shared_factors(
    sensor: str, symbol: str, logs: Mapping[str, list[tuple[float, float]]], shared: Sequence[Matrix]
) -> SensorFactors:
    """Return the factors of the recordings that the logarithms of all axes share, by generalised least squares for
    m_i + d_r, with the correlations `shared` (A, A) of the errors in each recording."""
    from scipy.special import gammaincc

    x, s = np.moveaxis(np.array(list(logs.values())), -1, 0)
    count, first = len(logs), int(np.flatnonzero(np.isfinite(x).any(axis=0))[0])
    scale = float(np.nanmin(s))  # so that no weight overflows
    blocks, targets = [], []
    for recording, correlations in enumerate(shared):
        axes = np.flatnonzero(np.isfinite(x[:, recording]))
        errors = s[axes, recording] / scale
        root = np.linalg.cholesky(correlations[np.ix_(axes, axes)] * np.outer(errors, errors))
        design = np.zeros((axes.size, count + x.shape[1]))
        design[np.arange(axes.size), axes] = 1
        design[:, count + recording] = recording != first
        solved = np.linalg.solve(root, np.column_stack([design, x[axes, recording]]))
        blocks.append(solved[:, :-1])
        targets.append(solved[:, -1])
    matrix, target = np.vstack(blocks), np.concatenate(targets)
    inverse = np.linalg.pinv(matrix)
    null = target - matrix[:, :count] @ np.linalg.pinv(matrix[:, :count]) @ target
    gain = float(np.sum(null**2) - np.sum((target - matrix @ inverse @ target) ** 2))
    freedom = int(np.linalg.matrix_rank(matrix)) - count
    d, errors = (inverse @ target)[count:], scale * np.linalg.norm(inverse, axis=1)[count:]
    # A recording that shares no axis with the first one, or with one that does, has no factor.
    comparable = np.abs((inverse @ matrix - np.eye(matrix.shape[1]))[count:]).max(axis=1) < 1e-6
    comparable[first], d[first], errors[first] = True, 0.0, 0.0
    factors = [
        (math.exp(size), math.exp(size - _Z * error), math.exp(size + _Z * error)) if is_known else None
        for size, error, is_known in zip(d.tolist(), errors.tolist(), comparable, strict=True)
    ]
    return SensorFactors(
        sensor=sensor, symbol=symbol, axes=tuple(logs), factors=tuple(factors),
        pvalue=float(gammaincc(freedom / 2, max(gain, 0.0) / (2 * scale**2))),
    )  # fmt: skip


def _adjust(rows: Sequence[Tested], size: float) -> list[Tested]:
    """Return the rows with p-values adjusted by Holm's method, and whether each number agrees at the level `size`."""
    adjusted = holm([math.nan if row.pvalue is None else row.pvalue for row in rows]).tolist()
    return [
        row if row.pvalue is None else replace(row, adjusted=p, agrees=p > size)
        for row, p in zip(rows, adjusted, strict=True)
    ]


def _beside(
    rows: Sequence[SharedNumber], reference: Mapping[str, tuple[float, str]]
) -> tuple[list[SharedNumber], tuple[str, ...]]:
    """Return the numbers with their reference values, and the keys of references for which there is no number."""
    compared, unmatched = list(rows), []
    # References for axes are set last, so that they replace references for sensors.
    for key in sorted(reference, key=lambda key: key.rpartition(".")[0] in {row.axis for row in rows}):
        name, _, symbol = key.rpartition(".")
        axes = {row.axis: row.unit for row in rows if name in (row.axis, sensor_of(row.axis))}
        if not axes:
            names = ", ".join(dict.fromkeys(name for row in rows for name in (sensor_of(row.axis), row.axis) if name))
            raise OptionError(argument="reference", expected=f"of {names}, such as '{rows[0].axis}.N'", got=key)
        places = [k for k, row in enumerate(rows) if row.axis in axes and row.symbol == symbol]
        for k in places:
            compared[k] = replace(compared[k], reference=as_reference(key, reference[key], rows[k].unit))
        if not places:
            if symbol not in LAWS:
                expected = f"of {', '.join(LAWS)} or another number of the calibrations"
                raise OptionError(argument="reference", expected=expected, got=key)
            unmatched.append(key)
    return compared, tuple(unmatched)
