"""That `shown.missing` sees what is not as it was printed, and lets through what another machine would print."""

import pytest

from tests.docs.shown import missing
from tests.helpers import each

PRINTED = """Calibration of static.csv

                gyro_x         gyro_y
  ─────────────────────────────────────
  model          GM+WN       GM+WN+RW
  N (deg/√h)     0.266   0.217 ± 61 %
  B (deg/h)     ≤ 14.2    3.5 … 18.25

- gyro_x: known to no better than 50 %; 20 % takes 80 min
- of 8 units 1.05e-03 m/s
error: the unit of gyro_x is neither declared nor named in the file. In deg/s the noise would be 0.0115 deg/s/√Hz.
"""
BROKEN = """error: the unit of gyro_x is neither declared nor named in the file.
In deg/s the noise would be 0.0116 deg/s/√Hz.
"""
HEAD = "                gyro_x         gyro_y\n  ─────────────────────────────────────\n"

SAME = {
    "a long line broken": BROKEN,
    "all of it": PRINTED,
    "some lines": HEAD,
    "lines left out": "Calibration of static.csv\n…\n  model          GM+WN       GM+WN+RW\n  …\n- of 8 units …",
    "nothing left out": "  model          GM+WN       GM+WN+RW\n…\n  N (deg/√h)     0.266   0.217 ± 61 %\n",
    "a line cut": "- gyro_x: known to no better than 50 %; …\n- of 8 units 1.05e-03 m/s\n",
    "a number cut": "  N (deg/√h)     0.266   0.217…\n",
    "dots that were printed": "  B (deg/h)     ≤ 14.2    3.5 … 18.25\n",
    "another rounding": "  B (deg/h)     ≤ 14.3    3.5 … 18.20\n",
    "columns that moved": HEAD.replace(" gyro_x", "gyro_x") + "…\n  B (deg/h)    ≤ 14.2    3.5 … 18.3\n",
}

WRONG = {
    "another word in a broken line": BROKEN.replace("noise", "sound"),
    "a line broken without its end": BROKEN.replace(" 0.0116 deg/s/√Hz.", ""),
    "a short line broken": "- gyro_x: known to no better than 50 %;\n20 % takes 80 min\n",
    "another number": PRINTED.replace("0.266", "0.286"),
    "another count": PRINTED.replace("8 units", "9 units"),
    "another sign": PRINTED.replace("3.5 …", "-3.5 …"),
    "another power": PRINTED.replace("e-03", "e-04"),
    "another word": PRINTED.replace("better", "worse"),
    "another limit": PRINTED.replace("≤", "≥"),
    "a letter more": PRINTED.replace("gyro_y", "gyro_yy"),
    "a word more": PRINTED.replace("80 min", "80 min, upper limit"),
    "a word less": "- gyro_x: known to no better than 50 %; 20 % takes\n",
    "a line more": PRINTED + "- of 8 units 1.05e-03 m/s\n",
    "a line left out unsaid": PRINTED.replace("  model          GM+WN       GM+WN+RW\n", ""),
    "lines in another order": "- of 8 units 1.05e-03 m/s\n…\nCalibration of static.csv\n",
    "another space": PRINTED.replace("  model", "   model"),
    "another space beside a number": PRINTED.replace("  0.217", " 0.217"),
    "a line cut elsewhere": "- gyro_x: known to no worse …\n",
    "a number cut elsewhere": "  N (deg/√h)     0.266   0.317…\n",
}


@pytest.mark.parametrize("name", SAME)
def test_what_was_printed_is_not_missing(name):
    assert missing(SAME[name], PRINTED) == ""


@each("name", WRONG)
def test_what_was_not_printed_is_missing(name):
    assert missing(WRONG[name], PRINTED).startswith("shown   |")


def test_the_nearest_line_is_told():
    assert missing("- of 9 units 1.05e-03 m/s", PRINTED) == (
        "shown   |- of 9 units 1.05e-03 m/s\nprinted |- of 8 units 1.05e-03 m/s"
    )
