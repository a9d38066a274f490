"""Warnings and steps in the log, and progress bars."""

import logging
import sys
import warnings
from types import SimpleNamespace

import pytest

import gmwm
from gmwm.base.errors import GmwmWarning
from gmwm.base.remarks import Remark
from gmwm.base.reporting import bar_html, reported, warn

IMU = gmwm.simulate({"gyro_x": "WN(sigma2=4e-7)"}, rate=100.0, samples=4000, rng=1)


def test_a_warning_is_also_logged(caplog):
    remark = Remark.of("no-workers", address="tcp://x")
    with caplog.at_level(logging.INFO, logger="gmwm"), warnings.catch_warnings(record=True) as issued:
        warnings.simplefilter("always")
        warn(GmwmWarning(remark), stacklevel=1)
    (warning,) = issued
    assert warning.filename == __file__
    (record,) = caplog.records
    assert (record.name, record.levelno, record.code) == ("gmwm", logging.INFO, "no-workers")
    assert record.getMessage() == str(warning.message)


def test_the_log_prints_nothing_by_itself():
    assert [type(handler) for handler in logging.getLogger("gmwm").handlers] == [logging.NullHandler]


@pytest.mark.slow
def test_a_calibration_logs_its_steps(caplog):
    steps = []
    with caplog.at_level(logging.INFO, logger="gmwm"):
        gmwm.calibrate(IMU, within="WN", progress=lambda done, number, text: steps.append((done, number, text)))
    logged = [record.args[1:] for record in caplog.records if record.args and record.args[0] == "calibrating"]
    assert logged == steps
    assert steps[-1][0] == steps[-1][1]


def test_a_notebook_shows_and_updates_a_bar(monkeypatch):
    shown = []
    handle = SimpleNamespace(update=shown.append)
    cell = SimpleNamespace(HTML=str, display=lambda html, display_id: shown.append(html) or handle)
    ipython = SimpleNamespace(get_ipython=lambda: SimpleNamespace(kernel=None))
    monkeypatch.setitem(sys.modules, "IPython", ipython)
    monkeypatch.setitem(sys.modules, "IPython.display", cell)
    with reported(True, "calibrating") as show:
        show(1, 2, "a < b")
    assert shown == [bar_html("calibrating", 0, 1, ""), bar_html("calibrating", 1, 2, "a < b")]
    assert "a &lt; b" in shown[1]


def test_a_terminal_shows_a_bar(capsys):
    with reported(True, "calibrating") as show:
        show(2, 2, "gyro_x: fit")
    assert capsys.readouterr().out == ""
