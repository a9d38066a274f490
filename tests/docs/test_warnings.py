"""The page on warnings quotes what the program says, and has an entry for what it says."""

import ast
import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import gmwm
from gmwm import cautions
from gmwm._text import OVERRULED
from gmwm.calibration.summary_text import advice
from gmwm.inspection.knocks import Knock, Step
from gmwm.inspection.warm_up import WarmUp
from gmwm.time_base import TimeBase
from tests.docs.pages import DOCS

PAGE = (DOCS / "howto" / "warnings.md").read_text(encoding="utf-8")
ENTRIES = [line for line in PAGE.splitlines() if line.startswith('**"')]
QUOTES = [quote for line in ENTRIES for quote in re.findall(r'\*\*"(.+?)"\*\*', line)]
SOURCE = DOCS.parent / "src" / "gmwm"


def pieces(quote):
    """What stands between the places of names and numbers."""
    return [piece.strip() for piece in quote.split("…") if re.search(r"\w\w", piece)]


def fits(quote, text):
    return re.search(".*".join(map(re.escape, pieces(quote))), text) is not None


def has_entry(text):
    return any(fits(quote, text) for quote in QUOTES)


@cache
def written():
    """The literal texts of each module."""
    found = []
    for path in sorted(SOURCE.rglob("*.py")):
        nodes = ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        texts = [node.value for node in nodes if isinstance(node, ast.Constant) and isinstance(node.value, str)]
        found.append("\n".join(texts))
    return found


@cache
def of_recordings():
    """All cautions that a look at a recording can bring."""
    base = TimeBase(100.0, True, 0.0, 0.005, ((7, 0.5),), 3, 2)
    look = gmwm.inspect(gmwm.simulate({"accel_x": "WN(sigma2=1e-4)"}, rate=100.0, duration=10.0, rng=1))
    coarse = {axis: replace(found, lsb=10 * found.noise) for axis, found in look.axes.items()}
    knock, step = (
        Knock(time=1.0, duration=0.1, axes=("gyro_x",), peak=20.0),
        Step(time=1.0, axis="gyro_x", size=0.1, times=20.0),
    )
    return [
        *cautions.about_time(2, base),
        *cautions.about_motion({"gyro_x": (1.0, 5.0)}, 2.0, (knock, knock)),
        *cautions.about_motion({}, 0.3, ()),
        *cautions.about_steps((step, step)),
        *cautions.about_warm_up((WarmUp(axis="gyro_x", size=0.1, duration=100.0, times=20.0),), False),
        *cautions.about_values(coarse, 19.6),
        *cautions.about_values({}, 10.1),
        *cautions.about_units({"gyro_x": 0.1}),
        *cautions.about_declared([f"gyro: deg/s, declared{OVERRULED} rad/s"]),
    ]


@pytest.mark.parametrize("quote", QUOTES)
def test_a_quote_is_what_the_program_says(quote):
    assert pieces(quote)
    in_source = any(all(part in text for part in pieces(quote)) for text in written())
    # Sentences that are put together from parts stand nowhere as a whole.
    assert in_source or any(fits(quote, text) for text in of_recordings())


def test_there_are_entries_and_each_says_what_to_do():
    assert len(QUOTES) > 40
    lines = PAGE.splitlines()
    for entry in ENTRIES:
        assert len(lines[lines.index(entry) + 1]) > 10, entry


def test_an_unknown_text_has_no_entry():
    assert not has_entry("all is well")


def test_all_cautions_of_a_recording_have_entries():
    assert len(of_recordings()) == 15
    assert [text for text in of_recordings() if not has_entry(text)] == []


def test_all_advice_of_a_difficult_calibration_has_entries():
    noise = {
        "gyro_x": "WN(sigma2=4e-7) + SIN(frequency=21.3, power=6e-7)",
        "gyro_y": "GM(beta=200, sigma2=4e-7) + DR(omega=1e-7)",
        "gyro_z": "GM(beta=0.02, sigma2=4e-8) + WN(sigma2=4e-7)",
    }
    imu = gmwm.simulate(noise, rate=100.0, duration=200.0, rng=1)
    values = {axis: imu[axis].values.copy() for axis in imu.axes}
    for start in range(1000, 20_000, 1500):
        values["gyro_z"][start : start + 50] += 0.05 * np.sin(np.arange(50))
    found = gmwm.calibrate(gmwm.Imu.from_arrays(values, rate=100.0), within="GM + WN + DR")
    said = advice(found)
    for words in ("the test rejects", "knocks", "The robust curve was fitted", "the output drifts", "N counts"):
        assert any(words in text for text in said), words
    assert [text for text in said if not has_entry(text)] == []
