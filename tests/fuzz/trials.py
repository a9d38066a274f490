"""What is done with a changed file: it must end with an answer or one error of gmwm."""

from __future__ import annotations

import json
import warnings
from pathlib import Path
from typing import Any

import numpy as np

import gmwm
from gmwm.applications.app.session import Session
from gmwm.base.errors import GmwmError, GmwmWarning
from gmwm.base.time_base import parse_length
from gmwm.files.columns.axis_units import parse_scale
from gmwm.files.columns.columns import parse_columns
from gmwm.files.importers import given_noise
from gmwm.files.importers.values import parse_reference
from gmwm.files.readers.topics import inertial_topics

AXES = ("gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z")
UNITS = {"gyro": "rad/s", "accel": "m/s²"}
OPTIONS: tuple[dict[str, Any], ...] = (
    {},
    {"units": UNITS},
    {"units": UNITS, "bad_lines": "skip"},
    {"units": UNITS, "rate": 100.0, "columns": list(AXES)},
    {"units": UNITS, "rate": 100.0, "columns": {"gyro_x": 1}},
    {"units": UNITS, "format": "imu:LN200"},
)
"""Options of `read`, tried one after the other until a recording is read."""


def read_trial(path: Path) -> str:
    """Read a file, and use what was read. Return "answer" or the name of the last error.

    Raises
    ------
    Exception
        Anything but an error of gmwm, and an AssertionError if the stream differs from the recording.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", GmwmWarning)
        # From the extensions of Python's own libraries, which end with the file.
        warnings.simplefilter("ignore", ResourceWarning)
        last = ""
        for options in OPTIONS:
            try:
                options = options | _topic(path)
                imu = gmwm.read(path, **options)
            except GmwmError as error:
                last = _checked(error)
                continue
            _use(imu)
            _compare(imu, path, options)
            return "answer"
        return last


def _topic(path: Path) -> dict[str, str]:
    """Return the first recording of a file with several."""
    several = inertial_topics(path)
    return {"topic": several[0]} if len(several) > 1 else {}


def _checked(error: GmwmError) -> str:
    """Return the name of an error, after a check of its texts."""
    text = str(error)
    assert 0 < len(text) < 3000, f"an error of {len(text)} characters"
    assert not any(ord(c) < 32 and c not in "\n\t" for c in text), f"control characters in {text!r}"
    return type(error).__name__


def _use(imu: gmwm.Imu) -> None:
    """Inspect a recording, and measure its wavelet variance."""
    for signal in imu.signals.values():
        assert np.all(np.isfinite(signal.values)), "values that are not finite"
    assert np.isfinite(imu.rate), "a rate that is not finite"
    assert imu.rate > 0, "a rate that is not positive"
    try:
        str(gmwm.inspect(imu))
        for robust in (False, True):
            for curve in gmwm.wavelet_variance(imu, robust=robust).values():
                assert np.all(np.isfinite(curve.variance)), "a variance that is not finite"
    except GmwmError as error:
        _checked(error)


def _compare(imu: gmwm.Imu, path: Path, options: dict[str, Any]) -> None:
    """Compare a stream of the file with the recording."""
    source = gmwm.stream(path, chunk=97, **options)
    chunks = list(source)
    for axis in imu.axes:
        values = np.concatenate([chunk[axis] for chunk in chunks])
        assert np.array_equal(values, imu[axis].values), f"the stream has other values of {axis}"
    assert source.time_base.gaps == imu.time_base.gaps, "the stream has other gaps"
    assert source.rate == imu.rate, "the stream has another rate"


def document_trial(path: Path) -> str:
    """Load a document, and use what was loaded. Return "answer" or the name of the error."""
    return _trial(_DOCUMENTS[path.name], path)


def import_trial(path: Path) -> str:
    """Import the noise of a file of another program. Return "answer" or the name of the error."""
    return _trial(lambda file: _use_noise(given_noise(file, 200.0)), path)


def text_trial(path: Path) -> str:
    """Use a text as the option that the name of the file states. Return "answer" or the name of the error."""
    return _trial(_TEXTS[path.stem], path.read_bytes().decode("utf-8", "replace"))


def _trial(use: Any, source: Any) -> str:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", GmwmWarning)
        try:
            use(source)
        except GmwmError as error:
            return _checked(error)
        return "answer"


def _use_noise(noise: Any) -> None:
    """Require that all numbers of imported noise are finite, and that the models read back."""
    for model in noise.models.values():
        assert gmwm.Model.parse(str(model)) == model, str(model)
        assert all(np.isfinite(value) for value in model.parameters.values()), str(model)


def _model(text: str) -> None:
    model = gmwm.Model.parse(text)
    assert gmwm.Model.parse(str(model)) == model, str(model)


_TEXTS = {
    "datasheet": lambda text: _use_noise(given_noise(text, 200.0)), "model": _model, "reference": parse_reference,
    "columns": parse_columns, "scale": parse_scale, "length": lambda text: parse_length(text, "start"),
}  # fmt: skip


def _calibration(path: Path) -> None:
    found = gmwm.Calibration.load(path)
    found.summary()
    for fit in found.values():
        fit.summary()


def _fits(path: Path) -> None:
    from gmwm.cli.plan import _as_seen, fits_in, pilot

    _, fits = fits_in(path)
    for axis, content in fits.items():
        gmwm.Fit.from_dict(content).summary()
        _, found = pilot(path, axis)
        model, _ = _as_seen(found)
        gmwm.plan(model, duration=1000.0, rate=found["wavelet_variance"]["rate"]).summary(0.2)


def _fleet(path: Path) -> None:
    gmwm.fleets.Fleet.load(path.parent).summary()


def _accumulator(path: Path) -> None:
    from gmwm.base.atomic_files import read_json

    live = gmwm.WaveletAccumulator.from_dict(_json(read_json, path))
    live.update([0.1, 0.2, -0.1])
    live.result()


def _monitor(path: Path) -> None:
    from gmwm.base.atomic_files import read_json

    live = gmwm.Monitor.from_dict(_json(read_json, path))
    live.update({axis: np.zeros(50) for axis in live.axes})


def _json(read: Any, path: Path) -> Any:
    """Read a JSON file; what is not JSON is no document of gmwm."""
    try:
        return read(path)
    except ValueError as error:
        raise GmwmError(f"not JSON: {str(error)[:200]}") from error


def _session(path: Path) -> None:
    session = Session.load(path)
    assert Session.from_text(session.to_text()) == session


TRIALS = {"documents": document_trial, "importers": import_trial, "texts": text_trial}
"""What is done with the input of the families that are no recordings."""
_DOCUMENTS = {
    "calibration.json": _calibration, "fits.json": _fits, "fleet.json": _fleet, "accumulator.json": _accumulator,
    "monitor.json": _monitor, "session.json": _session,
}  # fmt: skip


def dumped(content: Any) -> bytes:
    """Write a changed document as JSON."""
    return json.dumps(content).encode()
