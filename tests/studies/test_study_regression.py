"""A reduced run of validation/study_regression.py: the slope is found, and its statements are written."""

import numpy as np
import pytest

from validation import study_regression

pytestmark = pytest.mark.slow


def test_the_slope_is_found_under_heavy_tails():
    result = study_regression.run(reduced=True)
    (judged,) = (row for row in result["rows"] if "noise" in row)
    departed = [row for row in result["rows"] if "departure" in row]
    assert judged["error"] < 2
    assert [row["accepted"] for row in departed] == [1.0, 1.0]
    assert [row["slope"] for row in departed] == pytest.approx([1.0, 1.0], abs=0.2)
    (read,) = (row for row in result["rows"] if "reading" in row)
    assert abs(read["attenuation"]) < 0.02
    still, changing = (row for row in result["rows"] if "changing" in row)
    assert (changing["found"], changing["slope"]) == (1.0, pytest.approx(0.02, abs=0.003))
    assert abs(still["slope"]) < 0.003
    assert study_regression.table(result).count("\n|") == 14


def test_generalised_least_squares_of_white_noise_are_ordinary_ones():
    course = study_regression.temperature("day cycle", np.random.default_rng(0))
    # A slope of white noise has the variance σ²/Σ(x − mean)².
    error = study_regression.exact_error(study_regression.NOISES["WN"][1], course)
    assert error == pytest.approx(1 / np.sqrt(np.sum((course - course.mean()) ** 2)), rel=1e-3)
