"""The session: a small document with checked values, and the commands that repeat it."""

import dataclasses
import json
import shlex
from types import SimpleNamespace

import jsonschema
import pytest

import gmwm
from gmwm.applications.app.page import numbers
from gmwm.applications.app.session import EMPTY, FORMAT, VERSION, Session, python_lines, shell_lines
from gmwm.base.errors import GmwmError, ModelError, OptionError, ReadError
from gmwm.calibration.number_verdicts import NumberVerdict, Usability
from gmwm.cli.main import app
from tests.helpers import raises

FULL = Session(
    file="my recording.csv",
    reading={
        "rate": 100, "units": {"gyro": "deg/s"}, "columns": {"time": None, "gyro_x": 3}, "skip": [(10, 20.5), (30, 31)],
        "scale": {"gyro": 1 / 131}, "increments": ["gyro"], "gaps": "longest", "start": 0.1,
    },
    axis="gyro_x", robust=True, models={"gyro_x": "WN(sigma2=fixed(1e-6)) + 2*GM"}, confidence=0.9, curve="both",
    view="wavelet", units="si", rule="mean", inflation=2.5, horizon=0.1, export="openvins",
    reference={"gyro.N": "2.0 deg/√h"}, duration=600,
)  # fmt: skip


@pytest.mark.parametrize("session", [EMPTY, FULL], ids=["empty", "full"])
def test_a_session_survives_its_document(session):
    assert Session.from_text(session.to_text()) == session
    assert Session.from_dict(json.loads(json.dumps(session.to_dict()))) == session


@pytest.mark.parametrize("session", [EMPTY, FULL], ids=["empty", "full"])
def test_the_schema_accepts_every_session_and_no_other_key_or_type(session):
    validator, document = jsonschema.Draft202012Validator(Session.schema()), json.loads(session.to_text())
    assert validator.is_valid(document)
    for wrong in ({"speed": 1}, {"confidence": "high"}, {"reading": {"rates": 1}}, {"version": 2}, {"curve": "all"}):
        assert not validator.is_valid(document | wrong), wrong


def test_the_document_has_only_what_differs():
    assert EMPTY.to_dict() == {}
    assert Session(file="a.csv", models={"gyro_x": "WN+RW"}).to_dict() == {
        "file": "a.csv", "models": {"gyro_x": "WN + RW"},
    }  # fmt: skip


@pytest.mark.parametrize(
    ("values", "kind", "argument"),
    [
        ({"reading": {"rate": -1}}, OptionError, "rate"),
        ({"confidence": 95}, OptionError, "confidence"),
        ({"view": "psd"}, OptionError, "view"),
        ({"export": "../x"}, OptionError, "export"),
        ({"horizon": 0}, OptionError, "horizon"),
        ({"inflation": float("nan")}, OptionError, "inflation"),
    ],
)
def test_a_wrong_value_is_refused(values, kind, argument):
    with raises(kind, argument=argument):
        Session(**values)


def test_a_wrong_document_is_refused():
    for text in ("{", "[]", "{}", EMPTY.to_text().replace('"version": 1', '"version": 2')):
        with pytest.raises(ReadError):
            Session.from_text(text)
    with raises(ReadError, "surprise"):
        Session.from_dict({"surprise": 1})
    with pytest.raises(ModelError):
        Session.from_dict({"models": {"gyro_x": "WN + VN"}})


def test_the_shell_reads_its_command_as_the_session(monkeypatch):
    """The command that is shown, parsed by the command line, has the options of the session."""
    import typer

    calibrate, export = (shlex.split(line) for line in shell_lines(FULL))
    assert export == [
        *["gmwm", "export", "results/calibration.json", "--format", "openvins", "--axes", "mean", "--inflation", "2.5"],
        *["--horizon", "0.1s", "--output", "openvins.yaml"],
    ]  # fmt: skip
    asked = {}

    def opened(file, reading, *_, **__):
        asked.update(file=file, reading=reading)
        raise OptionError("seen")

    monkeypatch.setattr("gmwm.cli.calibrate.open_recording", opened)
    monkeypatch.setattr("gmwm.cli.calibrate.make_directory", lambda path: path)
    command = typer.main.get_command(app).commands["calibrate"]  # type: ignore[attr-defined]
    with raises(OptionError, "seen"):
        command.main(calibrate[2:], standalone_mode=False)
    assert str(asked["file"]) == FULL.file
    assert asked["reading"] == FULL.options


@pytest.mark.slow
def test_the_python_lines_run(tmp_path, monkeypatch):
    imu = gmwm.simulate({"gyro_x": "WN(sigma2=1e-6)", "accel_x": "WN(sigma2=1e-4)"}, rate=10.0, samples=4096, rng=1)
    monkeypatch.chdir(tmp_path)
    imu.write("a.csv")
    session = Session(file="a.csv", reading={"skip": [(10, 20)]}, models={"gyro": "WN", "accel": "WN"}, inflation=3)
    exec(compile("\n".join(python_lines(session)), "shown", "exec"), {})
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.csv", "calibration.json", "imu.yaml", "report.html"]
    assert "Inflation factor: 3" in (tmp_path / "imu.yaml").read_text(encoding="utf-8")


HOSTILE = (
    0, -1, 3, 1.5, True, "", "x", "kalibr", [], [[]], {}, {"a": 1}, {"rate": "x"}, {"skip": 5}, {"skip": [[1]]},
    {"unknown": 1}, {"units": 3}, {"columns": {"gyro_x": []}}, {"start": [1]}, {"gyro_x": 5}, {"gyro_x": "WN +"},
    None, 10**400, 1e400, float("nan"),
)  # fmt: skip


def test_every_wrong_value_of_a_document_is_one_error():
    refused = 0
    for field in dataclasses.fields(Session):
        for value in HOSTILE:
            text = json.dumps({"format": FORMAT, "version": VERSION, field.name: value})
            try:
                session = Session.from_text(text)
            except GmwmError:
                refused += 1
                continue
            assert Session.from_text(session.to_text()) == session
    assert refused > 200


def test_a_session_that_is_no_utf_8_is_one_error(tmp_path):
    path = tmp_path / "session.json"
    path.write_bytes(b"\xff\xfe{}")
    with raises(ReadError, code="not-text"):
        Session.load(path)


def test_the_numbers_for_a_horizon_are_those_of_the_files(tmp_path):
    imu = gmwm.simulate({"gyro_x": "WN(sigma2=1e-6) + GM(beta=0.02, sigma2=1e-9)"}, rate=100.0, samples=60_000, rng=5)
    found = gmwm.calibrate(imu, within="GM + WN + RW")
    assert found.datasheets["gyro_x"]["K"].upper_only
    job = SimpleNamespace(state="done", value=found, join=lambda _: None)
    for horizon in (1.0, 10.0):
        session = Session(file="a.csv", horizon=horizon, units="si")
        shown = str(numbers._effective(session, SimpleNamespace(calibration=lambda _: job), 1000.0))
        text = found.export(format="json", horizon=horizon)
        walk = json.loads(text)["axes"]["gyro_x"]["filter"]["K"]["value"]
        assert f"≤ {walk:.4g} rad" in shown
        assert "✗" not in shown
    refused = {"gyro_x": {"K": NumberVerdict(symbol="K", usability=Usability.DO_NOT_USE)}}
    job.value = SimpleNamespace(axes=found.axes, number_verdicts=refused)
    shown = str(numbers._effective(session, SimpleNamespace(calibration=lambda _: job), 1000.0))
    assert shown.count("✗") == 1
