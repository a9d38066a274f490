"""Do several recordings of one unit agree? Each number of their datasheets, tested; and the maker's beside them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import PurePath
from statistics import NormalDist

import numpy as np

from gmwm.calibration.agreement_result import Agreement, SharedNumber
from gmwm.calibration.findings import rejected
from gmwm.calibration.reference import as_reference
from gmwm.calibration.result import Calibration
from gmwm.calibration.tables import in_order, merged
from gmwm.datasheets import Datasheet, Entry
from gmwm.datasheets.bias import SYMBOL as BIAS
from gmwm.errors import OptionError, UnitError
from gmwm.signals import sensor_of
from gmwm.variance.slope_line import LAWS

_FARTHEST = 40.0
"""Standard errors beyond which no double tells a probability from zero."""
_SIGNED = "R"
"""The ramp has a sign, and its interval is symmetric about it; the intervals of all others are of the logarithm."""

Recording = Calibration | Mapping[str, Datasheet]


def agree(
    calibrations: Sequence[Recording],
    *,
    size: float = 0.05,
    labels: Sequence[str] | None = None,
    reference: Mapping[str, tuple[float, str]] | None = None,
) -> Agreement:
    """Tell which numbers of several recordings of one unit differ by more than chance.

    For a number that recordings r give as x_r with the standard errors s_r, from the widths of their intervals, the
    test of one value for all is

        Σ (x_r − x̄)²/s_r² ~ χ² with one degree of freedom less than recordings, x̄ the mean weighted by 1/s_r²,

    with x the logarithm, for the ramp R the number itself. Where the data of a recording only bound the number, its
    limit is compared with the interval of each of the others, and of the lot the least probable counts: they agree if
    the limit reaches the interval, where both are as wide as the test asks for. All p-values are adjusted by Holm's
    method, so that `size` is that of any false alarm among all numbers.

    Q, N, B, K and R are compared whatever the models, all others where all recordings have the same model; but not B
    of a flicker term with B read at the lowest point of a curve.

    Parameters
    ----------
    calibrations : sequence of Calibration, or of mappings of axis to Datasheet
        One for each recording; two at least.
    size : float
        Of the test of all numbers together.
    labels : sequence of str, optional
        Names of the recordings; those of their files by default.
    reference : mapping of "gyro.N" or "gyro_x.N" to (value, unit), optional
        Values of the maker, of a sensor or of one axis, in a unit as datasheets have it: (2.0, "deg/√h").

    Returns
    -------
    Agreement

    Raises
    ------
    OptionError
        If there are fewer than two recordings, they share no axis, or an option is not one of those it may be.
    UnitError
        If an axis has another unit in another recording, or a reference is in no unit of its number.

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
    if isinstance(size, bool) or not isinstance(size, int | float) or not 0 < size < 1:
        raise OptionError(f"size must be between 0 and 1, got {size!r}; 5 % is 0.05")
    names = _labels(calibrations, labels)
    axes = merged([list(sheet) for sheet in sheets])
    if not any(sum(axis in sheet for sheet in sheets) > 1 for axis in axes):
        raise OptionError(
            "calibrations must be of recordings with an axis in common; they have "
            + "; ".join(", ".join(sheet) for sheet in sheets)
        )
    rows = _adjusted([row for axis in axes for row in _of_axis(axis, sheets, names)], size)
    rows, unmatched = _beside(rows, reference or {})
    models = {axis: tuple(sheet[axis].model if axis in sheet else None for sheet in sheets) for axis in axes}
    rejections, failures = (_where(calibrations, names, of) for of in (rejected, lambda found: found.failed))
    return Agreement(
        labels=names,
        rows=tuple(rows),
        models=models,
        rejected=rejections,
        size=float(size),
        unmatched=unmatched,
        failed=failures,
    )


def _sheets(calibrations: Sequence[Recording]) -> list[Mapping[str, Datasheet]]:
    """The datasheets of each recording."""
    if not isinstance(calibrations, list | tuple) or len(calibrations) < 2:
        came = len(calibrations) if isinstance(calibrations, list | tuple) else type(calibrations).__name__
        raise OptionError(f"calibrations must be a list of two or more, one for each recording; got {came}")
    sheets: list[Mapping[str, Datasheet]] = []
    for place, found in enumerate(calibrations, start=1):
        sheet = found.datasheets if isinstance(found, Calibration) else found
        if not isinstance(sheet, Mapping) or not sheet or not all(isinstance(s, Datasheet) for s in sheet.values()):
            raise OptionError(
                f"calibrations must be Calibrations, or mappings of axis to Datasheet; number {place} is "
                f"{type(found).__name__}"
            )
        sheets.append(sheet)
    return sheets


def _labels(calibrations: Sequence[Recording], labels: Sequence[str] | None) -> tuple[str, ...]:
    if labels is None:
        stems = [PurePath(found.source).stem if isinstance(found, Calibration) else "" for found in calibrations]
        whole = all(stems) and len(set(stems)) == len(stems)
        return tuple(stems) if whole else tuple(str(k) for k in range(1, len(stems) + 1))
    names = tuple(labels)
    if isinstance(labels, str) or not all(isinstance(name, str) and name for name in names):
        raise OptionError(f"labels must be a sequence of names, got {labels!r}")
    if len(names) != len(calibrations) or len(set(names)) != len(names):
        raise OptionError(f"labels must be {len(calibrations)} names that differ, got {', '.join(names)}")
    return names


def _where(
    calibrations: Sequence[Recording], names: Sequence[str], of: Callable[[Calibration], Iterable[str]]
) -> dict[str, tuple[str, ...]]:
    """The recordings where an axis is one of some."""
    found: dict[str, tuple[str, ...]] = {}
    for name, calibration in zip(names, calibrations, strict=True):
        for axis in of(calibration) if isinstance(calibration, Calibration) else ():
            found[axis] = (*found.get(axis, ()), name)
    return found


# --- the tests --------------------------------------------------------------------------------------


def _of_axis(axis: str, sheets: Sequence[Mapping[str, Datasheet]], names: Sequence[str]) -> list[SharedNumber]:
    """The numbers of one axis, each with the p-value of its own test."""
    found = [sheet.get(axis) for sheet in sheets]
    units = {sheet.unit: name for sheet, name in zip(found, names, strict=True) if sheet is not None}
    if len(units) > 1:
        raise UnitError(
            f"{axis} must have one unit; it has {', '.join(f'{unit} in {name}' for unit, name in units.items())}: "
            "calibrate again, and say the units= of the file that is silent"
        )
    rows = []
    for symbol in in_order([list(sheet) for sheet in found if sheet is not None]):
        entries = tuple(None if sheet is None else sheet.get(symbol) for sheet in found)
        given = [(e, s) for e, s in zip(entries, found, strict=True) if e is not None and s is not None]
        first = given[0][0]
        alike = symbol in LAWS or len({s.model for s in found if s is not None}) == 1
        usable = [(entry, _reach(sheet.level)) for entry, sheet in given if _is_known(entry)]
        kinds = {entry.term is None for entry, _ in given if symbol == BIAS}
        reason = "interval" if len(usable) < 2 else ""
        reason = "one recording" if len(given) < 2 else "models" if not alike else "kinds" if len(kinds) > 1 else reason
        pvalue = None if reason else _pvalue(usable, symbol == _SIGNED)
        rows.append(
            SharedNumber(
                axis=axis,
                symbol=symbol,
                title=first.title,
                unit=first.unit,
                entries=entries,
                pvalue=pvalue,
                reason=reason,
            )
        )
    return rows


def _is_known(entry: Entry) -> bool:
    """Whether a number was estimated, and its interval says how well."""
    if entry.held or entry.low is None or entry.high is None or not math.isfinite(entry.high):
        return False
    return entry.upper_only or entry.low < entry.value < entry.high


def _reach(level: float) -> float:
    """Standard errors from the middle of an interval to its end."""
    return NormalDist().inv_cdf((1 + level) / 2)


def _pvalue(known: Sequence[tuple[Entry, float]], signed: bool) -> float:
    """Of entries, each with the reach of its interval in standard errors, if they are of one number."""
    from scipy.special import gammaincc

    points = [_point(entry, z, signed) for entry, z in known if not entry.upper_only]
    limits = [(entry, z) for entry, z in known if entry.upper_only]
    tests = []
    if len(points) > 1:
        x, s = np.array(points).T
        # In units of the smallest error: no weight is out of range, whatever the unit.
        weights = (s.min() / s) ** 2
        centre = float(weights @ x / weights.sum())
        tests.append(float(gammaincc((len(points) - 1) / 2, float(np.sum(((x - centre) / s) ** 2)) / 2)))
    tests += [_below(entry, z, *point, signed) for entry, z in limits for point in points]
    return min(1.0, len(tests) * min(tests)) if tests else 1.0


def _point(entry: Entry, z: float, signed: bool) -> tuple[float, float]:
    """A number on the scale of its interval, and its standard error there."""
    low, high = entry.low or 0.0, entry.high or 0.0
    if signed:
        return entry.value, (high - low) / (2 * z)
    return math.log(entry.value), (math.log(high) - math.log(low)) / (2 * z)


def _below(limit: Entry, z: float, x: float, s: float, signed: bool) -> float:
    """P-value of a limit below a number x ± s: with both as many standard errors wide, where the two would meet.

    Errors that are independent add by their squares, and the sum of both errors is more than that: it is a bound. The
    limit widens with the variance, as the amplitude of a term does; that of a number read off the curve, by a factor.
    """

    def apart(width: float) -> bool:
        value, high, share = abs(limit.value), limit.high or 0.0, width / z
        if signed:
            return value + share * (high - value) < abs(x) - width * s
        if limit.tau is not None:
            return math.log(value) + share * math.log(high / value) < x - width * s
        square = (value / high) ** 2
        return math.log(high) + 0.5 * math.log(max(square + share * (1 - square), 1e-300)) < x - width * s

    low, high = 0.0, _FARTHEST
    if not apart(low):
        return 1.0
    while high - low > 1e-6:
        middle = (low + high) / 2
        low, high = (middle, high) if apart(middle) else (low, middle)
    return math.erfc(high / math.sqrt(2))


def _adjusted(rows: Sequence[SharedNumber], size: float) -> list[SharedNumber]:
    """Holm: the smallest p-value times their number, the next times one less, and so on, each at least the last."""
    order = sorted((k for k, row in enumerate(rows) if row.pvalue is not None), key=lambda k: rows[k].pvalue or 0.0)
    made, least = list(rows), 0.0
    for place, k in enumerate(order):
        least = max(least, min(1.0, (len(order) - place) * (rows[k].pvalue or 0.0)))
        made[k] = replace(rows[k], adjusted=least, agrees=least > size)
    return made


# --- the maker's values -----------------------------------------------------------------------------


def _beside(
    rows: Sequence[SharedNumber], reference: Mapping[str, tuple[float, str]]
) -> tuple[list[SharedNumber], tuple[str, ...]]:
    """The numbers with the maker's values, those of an axis before those of its sensor; and what found no number."""
    made, unmatched = list(rows), []
    # Those of single axes last, as they overrule.
    for key in sorted(reference, key=lambda key: key.rpartition(".")[0] in {row.axis for row in rows}):
        name, _, symbol = key.rpartition(".")
        axes = {row.axis: row.unit for row in rows if name in (row.axis, sensor_of(row.axis))}
        if not axes:
            known = ", ".join(dict.fromkeys(name for row in rows for name in (sensor_of(row.axis), row.axis) if name))
            raise OptionError(f"reference must be of one of {known}, as '{rows[0].axis}.N'; got {key!r}")
        places = [k for k, row in enumerate(rows) if row.axis in axes and row.symbol == symbol]
        for k in places:
            made[k] = replace(made[k], reference=as_reference(key, reference[key], rows[k].unit))
        if not places:
            if symbol not in LAWS:
                raise OptionError(f"reference must be of {', '.join(LAWS)} or a number that there is; got {key!r}")
            unmatched.append(key)
    return made, tuple(unmatched)
