"""A file read into memory and a stream of it give the same samples, clock, remarks and variance, or the same error."""

import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import gmwm
from gmwm.base.errors import GmwmError
from gmwm.files.formats import text
from gmwm.files.readers import interpretation
from tests.laws.test_faults_of_one_axis import FAULTS, SIZE
from tests.readers.test_read_and_stream import both

ROWS = 3000
RANDOM = np.random.default_rng(21)
EVEN = np.arange(ROWS) / 100
JITTER = RANDOM.uniform(-1, 1, ROWS)


def _without(stamps: np.ndarray, share: float) -> np.ndarray:
    return np.where(RANDOM.random(ROWS) < share, np.nan, stamps)


CLOCKS = {
    "steady": EVEN,
    "in whole milliseconds of 137 Hz": np.round(np.arange(ROWS) / 137, 3),
    "jitter of 30 %": EVEN + 0.003 * JITTER,
    "jitter of 50 %": EVEN + 0.005 * JITTER,
    "drift of 4 %": np.cumsum(0.01 * np.linspace(1, 1.04, ROWS)),
    "drift of 4 % and jitter of 30 %": np.cumsum(0.01 * np.linspace(1, 1.04, ROWS)) + 0.003 * JITTER,
    "lost samples": EVEN + 0.01 * np.cumsum(RANDOM.random(ROWS) < 0.01),
    "a long gap": EVEN + 20 * (np.arange(ROWS) > 1700),
    "two rates": np.cumsum(np.where(np.arange(ROWS) < 1500, 0.01, 0.005)),
    "set back": EVEN - 3 * (np.arange(ROWS) > 2100),
    "repeated stamps": EVEN[np.maximum.accumulate(np.where(RANDOM.random(ROWS) < 0.02, 0, np.arange(ROWS)))],
    "two rows swapped": EVEN[np.r_[0:700, 701, 700, 702:ROWS]],
    "bursts": np.floor(EVEN / 0.08) * 0.08,
    "without some stamps": _without(EVEN, 0.01),
    "epoch": 1_700_000_000 + EVEN,
}
TEXTS = {
    "plain": lambda lines: lines,
    "blank lines": lambda lines: _inserted(lines, ""),
    "form feeds": lambda lines: _inserted(lines, "\f"),
    "blanks and tabs": lambda lines: _inserted(lines, " \t "),
    "rows of separators": lambda lines: _inserted(lines, ",,,"),
    "comments": lambda lines: _inserted(lines, "# a comment"),
    "rows commented out": lambda lines: ["#" * (1000 < k < 2000) + line for k, line in enumerate(lines)],
    "no-break spaces": lambda lines: _inserted(lines, "\u00a0"),
    "line separators": lambda lines: _inserted(lines, "\u2028"),
    "the header again": lambda lines: _inserted(lines, lines[0]),
    "words": lambda lines: _inserted(lines, "Restarted, battery low"),
    "too many cells": lambda lines: [line + ",7" * (k % 900 == 899) for k, line in enumerate(lines)],
    "empty cells": lambda lines: _last_cell(lines, lambda k: k % 77 == 76),
    "not a number": lambda lines: _last_cell(lines, lambda k: k % 77 == 76, "NaN"),
    "an axis at half the rate": lambda lines: _last_cell(lines, lambda k: k % 2 == 1),
    "an axis that ends": lambda lines: _last_cell(lines, lambda k: k > ROWS // 2),
    "cut in a row": lambda lines: [*lines[:-1], lines[-1][:9]],
    "cut in a number": lambda lines: [*lines[:-1], lines[-1][:-3]],
    "decimal commas": lambda lines: [line.replace(",", ";").replace(".", ",") for line in lines],
    "thousands": lambda lines: [lines[0], *(f"{line},1,004" for line in lines[1:])],
}  # fmt: skip


def _inserted(lines: list[str], line: str) -> list[str]:
    """Insert a line before every 60th row."""
    return [entry for k, row in enumerate(lines) for entry in ([line, row] if k and k % 60 == 0 else [row])]


def _last_cell(lines: list[str], chosen: Callable[[int], bool], cell: str = "") -> list[str]:
    """Replace the last cell of the chosen lines."""
    return [f"{line.rsplit(',', 1)[0]},{cell}" if chosen(k) else line for k, line in enumerate(lines)]


def _file(path: Path, *, fault: str, clock: str, form: str, end: str) -> Path:
    rng = np.random.default_rng(11)
    whole = 1e-3 * rng.normal(size=(3, SIZE)) + [[0.0], [0.0], [9.81]]
    whole[1] = FAULTS[fault](whole[1])
    rows = np.column_stack([CLOCKS[clock], whole[:, 4000 : 4000 + ROWS].T])
    lines = [
        ",".join("" if np.isnan(v) else f"{v:.9g}" if k else f"{v:.6f}" for k, v in enumerate(row)) for row in rows
    ]
    head = "time [s],gyro_x [rad/s],gyro_y [rad/s],accel_z [m/s^2]"
    path.write_text(end.join([*TEXTS[form]([head, *lines]), ""]), encoding="utf-8", newline="")
    return path


@pytest.fixture(autouse=True)
def _small_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(interpretation, "HEAD_ROWS", 1000)
    monkeypatch.setattr(text, "BLOCK_BYTES", 20_000)


@pytest.mark.slow
@settings(derandomize=True, max_examples=32, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    fault=st.sampled_from(sorted(FAULTS)), clock=st.sampled_from(sorted(CLOCKS)), form=st.sampled_from(sorted(TEXTS)),
    end=st.sampled_from(["\n", "\r\n"]),
    options=st.sampled_from([{}, {"bad_lines": "skip"}, {"rate": 100.0}, {"rate": 100.0, "bad_lines": "skip"}]),
)  # fmt: skip
def test_read_and_stream_agree(tmp_path: Path, fault: str, clock: str, form: str, end: str, options: dict) -> None:
    path = _file(tmp_path / "a.csv", fault=fault, clock=clock, form=form, end=end)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        message = ""
        try:
            imu = both(path, **options)
        except GmwmError as error:
            message = str(error)
        if message:
            for reading in (gmwm.read, lambda *a, **k: list(gmwm.stream(*a, **k).samples())):
                with pytest.raises(GmwmError) as caught:
                    reading(path, **options)
                assert str(caught.value) == message
            return
        curves, passed = gmwm.wavelet_variance(imu), gmwm.stream(path, **options).wavelet_variance()
        for axis, curve in curves.items():
            np.testing.assert_allclose(passed[axis].variance, curve.variance, rtol=1e-9)
