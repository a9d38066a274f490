"""Convert a calibration with its rankings to a JSON document and back; docs/calibration-format.md describes it."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping
from functools import partial
from importlib import metadata
from types import NoneType, UnionType
from typing import Any, NamedTuple, TypeVar

import numpy as np

from gmwm.base.arrays import Matrix
from gmwm.base.atomic_files import read_json
from gmwm.base.documents import DIALECT, Schemas, indented_json, plain, plain_fields
from gmwm.base.errors import ReadError
from gmwm.base.kinds import Document, field_types, require_kinds
from gmwm.base.remarks import Remark
from gmwm.base.text import with_article
from gmwm.calibration.additions import axis_additions
from gmwm.calibration.options import AGAIN, CalibrationOptions
from gmwm.calibration.recording_info import Recording
from gmwm.calibration.rest import BiasAtRest
from gmwm.calibration.result import AxisCalibration, Calibration
from gmwm.choosing.datasheets import Datasheet
from gmwm.choosing.selection import Ranking
from gmwm.choosing.selection.ranking import Candidate, SearchStep
from gmwm.fitting.estimation.criterion import Criterion
from gmwm.fitting.estimation.goodness import GoodnessOfFit
from gmwm.fitting.estimation.intervals import Interval
from gmwm.fitting.estimation.model_error import RelativeMisfit
from gmwm.fitting.estimation.result import Diagnostics, Fit
from gmwm.measuring.outliers import Verdict
from gmwm.measuring.regression.result import Regression
from gmwm.measuring.spectrum import PowerSpectrum
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.theory.processes.model import Model


def ranking_document(ranking: Ranking) -> dict[str, Any]:
    """Return a ranking as plain values: the result of `Ranking.to_dict`, and the fits of its candidates."""
    fits = {id(fit): fit for fit in (ranking.general, *(candidate.fit for candidate in ranking))}
    place = {key: k for k, key in enumerate(fits)}
    content = ranking.to_dict()
    for candidate, values in zip(ranking, content["candidates"], strict=True):
        values["asked"] = str(candidate.model)  # This text includes fixed values.
        values["fit"] = place[id(candidate.fit)]
    # What cannot be computed from the wavelet variance and the weighting matrix.
    stored = "model objective lower_bound relaxed_bound"
    return {
        **content, "fits": [plain_fields(f, stored, finite=False) | f.diagnostics.to_dict() for f in fits.values()],
        "weighting_matrix": ranking.weighting_matrix.tolist(), "wavelet_covariance": ranking.wavelet.tolist(),
    }  # fmt: skip


def ranking_from(content: Mapping[str, Any], wv: WaveletVariance) -> Ranking:
    """Restore a ranking from `ranking_document` and its wavelet variance; ReadError if impossible."""
    size = len(wv)
    matrix, wavelet = (_square(content[name], size) for name in ("weighting_matrix", "wavelet_covariance"))
    weighting = str(content["weighting"])
    fits = [_fit(values, wv, weighting, matrix) for values in content["fits"]]
    candidates = tuple(_candidate(values, fits[values["fit"]]) for values in content["candidates"])
    if sum(candidate.recommended for candidate in candidates) != 1:
        raise ReadError("not a ranking: one candidate must be recommended", advice=AGAIN)
    return Ranking(
        candidates=candidates, within=Model.parse(content["within"]), general=fits[0], weighting=weighting,
        weighting_matrix=matrix, wavelet=wavelet, confidence=float(content["confidence"]),
    )  # fmt: skip


def _candidate(values: Mapping[str, Any], fit: Fit) -> Candidate:
    wic = values["wic"]
    return Candidate(
        model=Model.parse(values["asked"]), fit=fit,
        wic=Criterion(loss=float(wic["loss"]), optimism=float(wic["optimism"]), method=wic["method"]),
        out_of_sample=values["out_of_sample"], difference=float(values["difference"]),
        parameters=int(values["parameters"]), equivalent=bool(values["equivalent"]),
        recommended=bool(values["recommended"]), same_as=values["same_as"],
    )  # fmt: skip


def _fit(values: Mapping[str, Any], wv: WaveletVariance, weighting: str, matrix: Matrix) -> Fit:
    model = Model.parse(values["model"])
    lower = values["lower_bound"]
    return Fit(
        wavelet_variance=wv, model=model,
        parameters={name: value for name, value in model.parameters.items() if value is not None},
        objective=float(values["objective"]), lower_bound=None if lower is None else float(lower),
        relaxed_bound=float(values["relaxed_bound"]), implied=model.wavelet_variance(wv.levels, wv.rate, wv.filter),
        decomposition=model.decomposition(wv.levels, wv.rate, wv.filter), weighting=weighting, weighting_matrix=matrix,
        diagnostics=Diagnostics.from_dict(values),
    )  # fmt: skip


def _square(values: Any, size: int) -> Matrix:
    matrix = np.array(values, dtype=np.float64)
    if matrix.shape != (size, size):
        raise ReadError(
            f"not a ranking: a matrix has the shape {matrix.shape}, but the data have {size} levels", advice=AGAIN
        )
    return matrix


FORMAT = "gmwm-calibration"
VERSION = 2
"""Version of the format. gmwm reads only this version. Adding a key to the format does not change the version."""

T = TypeVar("T")

_PARTS: Mapping[str, type | UnionType] = {
    "axes": Mapping, "failed": Mapping, "settings": Mapping, "source": str, "recording_remarks": list,
}  # fmt: skip
"""Required keys of the document, with the type of each value."""

_NUMBERS = {"Infinity": math.inf, "-Infinity": -math.inf, "NaN": math.nan}
"""Strings that replace the numbers that JSON cannot represent."""


def document(calibration: Calibration) -> dict[str, Any]:
    """Return a calibration as the dicts, lists, numbers and strings that are written to calibration.json."""
    content = {
        "format": FORMAT, "version": VERSION, "gmwm": metadata.version("gmwm"), "source": calibration.source,
        "settings": calibration.settings.to_dict(),
        "axes": {axis: _of_axis(entry) for axis, entry in calibration.axes.items()}, "failed": dict(calibration.failed),
        "recording_remarks": plain(calibration.recording_remarks, finite=False),
        "verdict": plain(calibration.verdict, finite=False), "use": plain(calibration.number_verdicts, finite=False),
        "remarks": plain(calibration.remarks, finite=False), "recording": plain(calibration.recording, finite=False),
        "recordings": plain(calibration.recordings, finite=False),
    }  # fmt: skip
    finite: dict[str, Any] = _plain(content)
    return finite


def _of_axis(axis: AxisCalibration) -> dict[str, Any]:
    content = {
        part.key: ranking_document(axis.ranking)
        if part.key == "ranking" else plain(getattr(axis, part.name), finite=False)
        for part in _AXIS_PARTS
    }  # fmt: skip
    content["replicates"] = plain(axis.replicates, finite=False)
    for addition in axis_additions():
        value = axis.additions.get(addition.name)
        content[addition.name] = None if value is None else addition.to_dict(value)
    return content


def calibration_schema() -> dict[str, Any]:
    """Return the JSON Schema of the document; see `Calibration.schema`."""
    infinite = {"enum": list(_NUMBERS)}
    schemas = Schemas({"anyOf": [{"type": "number"}, infinite]})
    types, parts = field_types(AxisCalibration), {part.key: part for part in _AXIS_PARTS}
    axis = {key: schemas.of(types[part.name]) for key, part in parts.items()}
    remarks = schemas.of(tuple[Remark, ...])
    properties = {
        "format": {"const": FORMAT}, "version": {"const": VERSION}, "gmwm": {"type": "string"},
        "source": {"type": "string"}, "settings": {"type": "object"},
        "axes": {
            "type": "object", "minProperties": 1,
            "additionalProperties": {
                "type": "object", "properties": axis | {"ranking": {"type": "object"}},
                "required": [key for key, part in parts.items() if not part.later],
            },
        },
        "failed": {"type": "object", "additionalProperties": {"type": "string"}}, "recording_remarks": remarks,
        "verdict": schemas.of(Remark), "use": {"type": "object"}, "remarks": remarks,
        "recording": schemas.of(Recording | None), "recordings": schemas.of(Mapping[str, Recording]),
    }  # fmt: skip
    return {
        "$schema": DIALECT, "title": FORMAT, "type": "object", "properties": properties,
        "required": ["format", "version", *_PARTS], "$defs": schemas.by_name,
    }  # fmt: skip


def calibration(content: Any) -> Calibration:
    """Return the calibration that a document contains, or raise a ReadError that says what is missing or wrong."""
    require_format(content, "calibration", FORMAT, VERSION, advice=AGAIN, anew="Calibrate the recording again.")
    parsed = _numbers(content)
    _require_parts(parsed, _PARTS, "the document")
    if not parsed["axes"]:
        raise ReadError("the calibration is incomplete: 'axes' of the document is empty", advice=AGAIN)
    recording = parsed.get("recording")
    result = Calibration(
        axes={axis: _axis(axis, parsed["axes"]) for axis in parsed["axes"]},
        failed=parsed["failed"],
        settings=CalibrationOptions.from_dict(parsed["settings"]),
        source=parsed["source"],
        recording_remarks=_read("recording_remarks", lambda: tuple(map(Remark.from_dict, parsed["recording_remarks"]))),
        recording=None if recording is None else _read("recording", lambda: Recording.from_dict(recording)),
        recordings=_read(
            "recordings",
            lambda: {
                name: Recording.from_dict(description) for name, description in parsed.get("recordings", {}).items()
            },
        ),
    )
    require_kinds(result, "", Document("calibration", AGAIN))
    return result


def _axis(axis: str, axes: Mapping[str, Any]) -> AxisCalibration:
    _require_parts(axes, {axis: Mapping}, "axes")
    content, fields = axes[axis], dict[str, Any]()
    _require_parts(content, {part.key: part.kind for part in _AXIS_PARTS if not part.later}, axis)
    for part in _AXIS_PARTS:
        if (value := content.get(part.key)) is not None:
            fields[part.name] = _read(f"{axis}.{part.key}", partial(part.read, value))
        elif not part.later:
            fields[part.name] = None
    curve = fields["fit"].wavelet_variance
    fields["ranking"] = _read(f"{axis}.ranking", lambda: ranking_from(content["ranking"], curve))
    fields["additions"] = {
        addition.name: _read(f"{axis}.{addition.name}", partial(addition.from_dict, content[addition.name]))
        for addition in axis_additions() if content.get(addition.name) is not None
    }  # fmt: skip
    return AxisCalibration(**fields)


def _intervals(content: Mapping[str, Any]) -> dict[str, Interval]:
    intervals = {name: (float(low), float(high)) for name, (low, high) in content.items()}
    for name, (low, high) in intervals.items():
        if low > high:
            raise ReadError(f"the interval of {name} begins at {low!r} and ends at {high!r}", advice=AGAIN)
    return intervals


class _AxisEntry(NamedTuple):
    """Part of the entry of an axis: key, attribute, type in JSON, reader, and whether older documents lack it."""

    key: str
    name: str
    kind: type | UnionType
    read: Callable[[Any], Any]
    later: bool = False


_OPTIONAL: Any = Mapping | NoneType
_AXIS_PARTS = (
    _AxisEntry("fit", "fit", Mapping, Fit.from_dict),
    _AxisEntry("confidence_intervals", "intervals", Mapping, _intervals),
    _AxisEntry("goodness_of_fit", "test", _OPTIONAL, GoodnessOfFit.from_dict),
    _AxisEntry("datasheet", "datasheet", Mapping, Datasheet.from_dict),
    _AxisEntry("contamination", "verdict", _OPTIONAL, Verdict.from_dict), _AxisEntry("needed", "needed", Mapping, dict),
    _AxisEntry("ranking", "ranking", Mapping, lambda content: content),
    _AxisEntry("spectrum", "spectrum", _OPTIONAL, PowerSpectrum.from_dict),
    _AxisEntry("misfit", "misfit", _OPTIONAL, RelativeMisfit.from_dict),
    _AxisEntry("model_error", "model_error", float, lambda error: error), _AxisEntry("tried", "tried", list, tuple),
    _AxisEntry("search", "search", list, lambda steps: tuple(map(SearchStep.from_dict, steps)), later=True),
    _AxisEntry("regression", "regression", _OPTIONAL, Regression.from_dict),
    _AxisEntry("left_in", "left_in", float | NoneType, lambda value: value),
    _AxisEntry("rest", "rest", _OPTIONAL, BiasAtRest.from_dict, later=True),
)  # fmt: skip


def _require_parts(content: Mapping[str, Any], parts: Mapping[str, type | UnionType], where: str) -> None:
    """Raise a ReadError if a required key is missing or its value has the wrong type. `where` names the mapping."""
    for key, kind in parts.items():
        if key not in content:
            raise ReadError(f"the calibration is incomplete: {where} has no {key!r}", advice=AGAIN)
        if not isinstance(content[key], kind):
            expected = "a string" if kind is str else "a list" if kind is list else "an object"
            got = "null" if content[key] is None else with_article(type(content[key]).__name__)
            raise ReadError(f"not a calibration: {key!r} of {where} must be {expected}; got {got}", advice=AGAIN)


def _read(what: str, read: Callable[[], T]) -> T:
    try:
        return read()
    except ReadError as error:
        raise error.at(what) from error
    except KeyError as error:
        raise ReadError(f"the calibration is incomplete: {what} has no {error.args[0]!r}", advice=AGAIN) from error
    except (TypeError, ValueError, AttributeError, IndexError, ArithmeticError, AssertionError) as error:
        raise ReadError(f"not a calibration: {what} cannot be read: {error}", advice=AGAIN) from error


def as_text(content: Mapping[str, Any]) -> str:
    """Return the document as JSON text."""
    return indented_json(content) + "\n"


def read_document(path: str | os.PathLike[str], what: str, advice: str) -> Any:
    """Read a document, or raise a ReadError if it is not JSON."""
    try:
        return read_json(path)
    except ValueError as error:
        raise ReadError(
            f"{path} is not a {what}: it is not JSON, or it is truncated ({error})", advice=advice
        ) from error


def require_format(content: Any, what: str, format: str, version: int, *, advice: str, anew: str) -> None:
    """Raise a ReadError if a document has another format or version; `anew` is the advice for an older version."""
    if not isinstance(content, Mapping) or content.get("format") != format:
        raise ReadError(f'not a {what}: it has no "format": "{format}"', advice=advice)
    stated = content.get("version")
    if not isinstance(stated, int) or isinstance(stated, bool) or stated < 1:
        raise ReadError(f"not a {what}: version must be a whole number from 1; got {stated!r}", advice=advice)
    if stated != version:
        raise ReadError(
            f"the {what} has version {stated} of the format, written by gmwm {content.get('gmwm')}; this gmwm reads "
            f"version {version}",
            advice="Install a newer gmwm: `pip install --upgrade gmwm`." if stated > version else anew,
        )


def _plain(value: Any) -> Any:
    """Return a value with lists instead of tuples and arrays, and strings instead of NaN and infinite numbers."""
    if type(value) in (str, int, bool, NoneType) or (type(value) is float and math.isfinite(value)):
        return value
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, list | tuple):
        finite = set(map(type, value)) == {float} and all(map(math.isfinite, value))
        return list(value) if finite else [_plain(item) for item in value]
    if isinstance(value, dict | Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, float) and not math.isfinite(value):
        return next(word for word, number in _NUMBERS.items() if number == value or word == "NaN")
    return value


def _numbers(value: Any) -> Any:
    """Return a value with numbers instead of the strings of `_NUMBERS`."""
    if isinstance(value, Mapping):
        return {key: _numbers(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_numbers(item) for item in value]
    return _NUMBERS.get(value, value) if isinstance(value, str) else value
