"""A calibration as a JSON document and back; docs/calibration-format.md describes it."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Mapping
from dataclasses import asdict
from importlib import metadata
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from gmwm.calibration.rankings import ranking_document, ranking_from
from gmwm.calibration.result import AxisCalibration, Calibration, Settings
from gmwm.datasheets import Datasheet
from gmwm.errors import ReadError
from gmwm.estimation.result import Fit
from gmwm.inference.goodness import GoodnessOfFit
from gmwm.outliers import Verdict

FORMAT = "gmwm-calibration"
VERSION = 1
"""Of the document. A reader takes its own version and older ones; new keys alone do not raise it."""

T = TypeVar("T")

_NUMBERS = {"Infinity": math.inf, "-Infinity": -math.inf, "NaN": math.nan}
"""What JSON has no number for, and the texts in its place."""


def document(found: Calibration) -> dict[str, Any]:
    """A calibration as plain numbers, lists and texts, as they stand in the file."""
    content = {
        "format": FORMAT,
        "version": VERSION,
        "gmwm": metadata.version("gmwm"),
        "source": found.source,
        "settings": asdict(found.settings),
        "axes": {axis: _of_axis(one) for axis, one in found.axes.items()},
        "failed": dict(found.failed),
        "cautions": list(found.cautions),
    }
    plain: dict[str, Any] = _plain(content)
    return plain


def _of_axis(found: AxisCalibration) -> dict[str, Any]:
    return {
        "fit": found.fit.to_dict(),
        "confidence_intervals": {name: list(interval) for name, interval in found.intervals.items()},
        "goodness_of_fit": None if found.test is None else found.test.to_dict(),
        "datasheet": found.datasheet.to_dict(),
        "contamination": None if found.verdict is None else found.verdict.to_dict(),
        "needed": dict(found.needed),
        "notes": list(found.notes),
        "ranking": ranking_document(found.ranking),
    }


def calibration(content: Any) -> Calibration:
    """The calibration of a document.

    Raises
    ------
    ReadError
        If it is of another format or a newer version, or something in it is missing or wrong.
    """
    if not isinstance(content, Mapping) or content.get("format") != FORMAT:
        raise ReadError(f'not a calibration: it does not begin with "format": "{FORMAT}"')
    version = content.get("version")
    if not isinstance(version, int) or isinstance(version, bool) or version < 1:
        raise ReadError(f"not a calibration: its version should be a whole number from 1, got {version!r}")
    if version > VERSION:
        raise ReadError(
            f"this calibration is of version {version} of its format, written by gmwm {content.get('gmwm')}; this gmwm "
            f"reads versions up to {VERSION}: install a newer one"
        )
    parsed = _numbers(content)
    return _read(
        "it",
        lambda: Calibration(
            {axis: _axis(axis, one) for axis, one in parsed["axes"].items()},
            {str(axis): str(why) for axis, why in parsed["failed"].items()},
            Settings(**parsed["settings"]),
            str(parsed["source"]),
            tuple(parsed["cautions"]),
        ),
    )


def _axis(axis: str, content: Mapping[str, Any]) -> AxisCalibration:
    def found() -> AxisCalibration:
        fit = Fit.from_dict(content["fit"])
        test, verdict = content["goodness_of_fit"], content["contamination"]
        return AxisCalibration(
            fit,
            {name: (float(low), float(high)) for name, (low, high) in content["confidence_intervals"].items()},
            None if test is None else _test(test),
            Datasheet.from_dict(content["datasheet"]),
            ranking_from(content["ranking"], fit.wavelet_variance),
            None if verdict is None else Verdict.from_dict(verdict),
            {name: None if seconds is None else float(seconds) for name, seconds in content["needed"].items()},
            tuple(content["notes"]),
        )

    return _read(axis, found)


def _test(content: Mapping[str, Any]) -> GoodnessOfFit:
    return GoodnessOfFit(
        content["statistic"], content["df"], content["pvalue"], np.array(content["levels"], dtype=np.int64),
        tuple(content["left_out"]), content["method"],
    )  # fmt: skip


def _read(what: str, read: Callable[[], T]) -> T:
    try:
        return read()
    except ReadError as error:
        raise ReadError(f"{what}: {error}" if what not in str(error) else str(error)) from error
    except KeyError as error:
        raise ReadError(f"not a whole calibration: {what} has no {error.args[0]!r}") from error
    except (TypeError, ValueError, AttributeError) as error:
        raise ReadError(f"not a calibration: {what} cannot be understood: {error}") from error


def as_text(content: Mapping[str, Any]) -> str:
    """The document as the text of a file."""
    return json.dumps(content, allow_nan=False, ensure_ascii=False, indent=1) + "\n"


def read_text(path: str | os.PathLike[str]) -> Any:
    """The document in a file.

    Raises
    ------
    ReadError
        If the file is not JSON, or is cut short.
    """
    try:
        content = json.loads(Path(path).read_text(encoding="utf-8"))
    except ValueError as error:
        raise ReadError(f"{path} is not a calibration: no JSON, or cut short ({error})") from error
    if not isinstance(content, Mapping) or content.get("format") != FORMAT:
        raise ReadError(f'{path} is not a calibration: it does not begin with "format": "{FORMAT}"')
    return content


def _plain(value: Any) -> Any:
    """Lists for tuples and arrays, texts for what JSON has no number for."""
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
    """The way back."""
    if isinstance(value, Mapping):
        return {key: _numbers(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_numbers(item) for item in value]
    return _NUMBERS.get(value, value) if isinstance(value, str) else value
