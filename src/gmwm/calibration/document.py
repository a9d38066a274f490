"""Convert a calibration to a JSON document and back; docs/calibration-format.md describes the format."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Mapping
from functools import partial
from importlib import metadata
from types import NoneType, UnionType
from typing import Any, TypeVar

import numpy as np

from gmwm.base.atomic_files import read_json
from gmwm.base.errors import ReadError
from gmwm.base.kinds import Document, require_kinds
from gmwm.base.remarks import Remark
from gmwm.base.text import with_article
from gmwm.calibration.additions import axis_additions
from gmwm.calibration.options import AGAIN, CalibrationOptions
from gmwm.calibration.ranking_document import ranking_document, ranking_from
from gmwm.calibration.recording_info import Recording
from gmwm.calibration.rest import BiasAtRest
from gmwm.calibration.result import AxisCalibration, Calibration
from gmwm.choosing.datasheets import Datasheet
from gmwm.choosing.selection.search_steps import SearchStep
from gmwm.fitting.estimation.goodness import GoodnessOfFit
from gmwm.fitting.estimation.intervals import Interval
from gmwm.fitting.estimation.model_error import RelativeMisfit
from gmwm.fitting.estimation.result import Fit
from gmwm.measuring.outliers import Verdict
from gmwm.measuring.regression.result import Regression
from gmwm.measuring.spectrum import PowerSpectrum

FORMAT = "gmwm-calibration"
VERSION = 2
"""Version of the format. gmwm reads only this version. Adding a key to the format does not change the version."""

T = TypeVar("T")

_PARTS: Mapping[str, type | UnionType] = {
    "axes": Mapping, "failed": Mapping, "settings": Mapping, "source": str, "recording_remarks": list,
}  # fmt: skip
_AXIS_PARTS: Mapping[str, type | UnionType] = {
    "fit": Mapping, "confidence_intervals": Mapping, "goodness_of_fit": Mapping | NoneType, "datasheet": Mapping,
    "contamination": Mapping | NoneType, "needed": Mapping, "ranking": Mapping,
    "regression": Mapping | NoneType, "left_in": float | NoneType,
    "spectrum": Mapping | NoneType, "misfit": Mapping | NoneType, "model_error": float, "tried": list,
}  # fmt: skip
"""Required keys of the document and of the entry of an axis, with the type of each value."""

_NUMBERS = {"Infinity": math.inf, "-Infinity": -math.inf, "NaN": math.nan}
"""Strings that replace the numbers that JSON cannot represent."""


def document(calibration: Calibration) -> dict[str, Any]:
    """Return a calibration as the dicts, lists, numbers and strings that are written to calibration.json."""
    content = {
        "format": FORMAT,
        "version": VERSION,
        "gmwm": metadata.version("gmwm"),
        "source": calibration.source,
        "settings": calibration.settings.to_dict(),
        "axes": {axis: _of_axis(entry) for axis, entry in calibration.axes.items()},
        "failed": dict(calibration.failed),
        "recording_remarks": [remark.to_dict() for remark in calibration.recording_remarks],
        "verdict": calibration.verdict.to_dict(),
        "remarks": [remark.to_dict() for remark in calibration.remarks],
        "recording": None if calibration.recording is None else calibration.recording.to_dict(),
        "recordings": {name: entry.to_dict() for name, entry in calibration.recordings.items()},
    }
    plain: dict[str, Any] = _plain(content)
    return plain


def _of_axis(axis: AxisCalibration) -> dict[str, Any]:
    return {
        "fit": axis.fit.to_dict(),
        "confidence_intervals": {name: list(interval) for name, interval in axis.intervals.items()},
        "goodness_of_fit": None if axis.test is None else axis.test.to_dict(),
        "datasheet": axis.datasheet.to_dict(),
        "contamination": None if axis.verdict is None else axis.verdict.to_dict(),
        "needed": dict(axis.needed),
        "ranking": ranking_document(axis.ranking),
        "spectrum": None if axis.spectrum is None else axis.spectrum.to_dict(),
        "misfit": None if axis.misfit is None else axis.misfit.to_dict(),
        "model_error": axis.model_error,
        "tried": list(axis.tried),
        "search": [step.to_dict() for step in axis.search],
        "regression": None if axis.regression is None else axis.regression.to_dict(),
        "left_in": axis.left_in,
        "rest": None if axis.rest is None else axis.rest.to_dict(),
        "replicates": None if axis.replicates is None else axis.replicates.to_dict(),
        **{
            addition.name: None if (value := axis.additions.get(addition.name)) is None else addition.to_dict(value)
            for addition in axis_additions()
        },
    }


def calibration(content: Any) -> Calibration:
    """Return the calibration that a document contains, or raise a ReadError that says what is missing or wrong."""
    if not isinstance(content, Mapping) or content.get("format") != FORMAT:
        raise ReadError(f'not a calibration: it has no "format": "{FORMAT}"', advice=AGAIN)
    version = content.get("version")
    if not isinstance(version, int) or isinstance(version, bool) or version < 1:
        raise ReadError(f"not a calibration: version must be a whole number from 1; got {version!r}", advice=AGAIN)
    if version != VERSION:
        newer = version > VERSION
        raise ReadError(
            f"the calibration has version {version} of the format, written by gmwm {content.get('gmwm')}; "
            f"this gmwm reads version {VERSION}",
            advice="Install a newer gmwm: `pip install --upgrade gmwm`." if newer else "Calibrate the recording again.",
        )
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
    content = axes[axis]
    _require_parts(content, _AXIS_PARTS, axis)
    test, verdict = content["goodness_of_fit"], content["contamination"]
    removed, bias = content["regression"], content.get("rest")
    spectrum, misfit = content["spectrum"], content["misfit"]
    fit = _read(f"{axis}.fit", lambda: Fit.from_dict(content["fit"]))
    return AxisCalibration(
        fit=fit,
        intervals=_read(f"{axis}.confidence_intervals", lambda: _intervals(content["confidence_intervals"])),
        test=None if test is None else _read(f"{axis}.goodness_of_fit", lambda: _test(test)),
        datasheet=_read(f"{axis}.datasheet", lambda: Datasheet.from_dict(content["datasheet"])),
        ranking=_read(f"{axis}.ranking", lambda: ranking_from(content["ranking"], fit.wavelet_variance)),
        verdict=None if verdict is None else _read(f"{axis}.contamination", lambda: Verdict.from_dict(verdict)),
        needed=content["needed"],
        spectrum=None if spectrum is None else _read(f"{axis}.spectrum", lambda: PowerSpectrum.from_dict(spectrum)),
        misfit=None if misfit is None else _read(f"{axis}.misfit", lambda: RelativeMisfit.from_dict(misfit)),
        model_error=content["model_error"],
        tried=tuple(content["tried"]),
        search=_read(f"{axis}.search", lambda: tuple(map(SearchStep.from_dict, content.get("search", ())))),
        regression=None if removed is None else _read(f"{axis}.regression", lambda: Regression.from_dict(removed)),
        left_in=content["left_in"],
        rest=None if bias is None else _read(f"{axis}.rest", lambda: BiasAtRest.from_dict(bias)),
        additions={
            addition.name: _read(f"{axis}.{addition.name}", partial(addition.from_dict, content[addition.name]))
            for addition in axis_additions()
            if content.get(addition.name) is not None
        },
    )


def _intervals(content: Mapping[str, Any]) -> dict[str, Interval]:
    intervals = {name: (float(low), float(high)) for name, (low, high) in content.items()}
    for name, (low, high) in intervals.items():
        if low > high:
            raise ReadError(f"the interval of {name} begins at {low!r} and ends at {high!r}", advice=AGAIN)
    return intervals


def _require_parts(content: Mapping[str, Any], parts: Mapping[str, type | UnionType], where: str) -> None:
    """Raise a ReadError if a required key is missing or its value has the wrong type. `where` names the mapping."""
    for key, kind in parts.items():
        if key not in content:
            raise ReadError(f"the calibration is incomplete: {where} has no {key!r}", advice=AGAIN)
        if not isinstance(content[key], kind):
            expected = "a string" if kind is str else "a list" if kind is list else "an object"
            got = "null" if content[key] is None else with_article(type(content[key]).__name__)
            raise ReadError(f"not a calibration: {key!r} of {where} must be {expected}; got {got}", advice=AGAIN)


def _test(content: Mapping[str, Any]) -> GoodnessOfFit:
    return GoodnessOfFit(
        statistic=content["statistic"],
        df=content["df"],
        pvalue=content["pvalue"],
        levels=np.array(content["levels"], dtype=np.int64),
        left_out=tuple(content["left_out"]),
        method=content["method"],
    )


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
    return json.dumps(content, allow_nan=False, ensure_ascii=False, indent=1) + "\n"


def read_text(path: str | os.PathLike[str]) -> Any:
    """Read the document in a calibration.json, or raise a ReadError if it is truncated or something else."""
    try:
        content = read_json(path)
    except ValueError as error:
        raise ReadError(
            f"{path} is not a calibration: it is not JSON, or it is truncated ({error})", advice=AGAIN
        ) from error
    if not isinstance(content, Mapping) or content.get("format") != FORMAT:
        raise ReadError(f'{path} is not a calibration: it has no "format": "{FORMAT}"', advice=AGAIN)
    return content


def _plain(value: Any) -> Any:
    """Return a value with lists instead of tuples and arrays, and strings instead of NaN and infinite numbers."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
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
