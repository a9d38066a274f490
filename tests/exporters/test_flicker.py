"""Flicker noise in the files of other programs: never lost, never white without a word."""

import math
import re

import numpy as np
import pytest

import gmwm
from gmwm import GM
from gmwm.choosing.datasheets.filter_numbers import filter_numbers
from gmwm.showing.exporters import export_formats
from gmwm.showing.exporters.base import _options, find_exporter
from tests.helpers import code_of

from .conftest import RATE, SAMPLES, calibrated, remarks_in, words
from .consumers import CONSUMERS, MARKOV

B2 = {"gyro": 4e-10, "accel": 4e-7}
TRUTHS = {
    f"{sensor}_{letter}": f"WN(sigma2={1000 * b2!r}) + FN(b2={b2!r})" for sensor, b2 in B2.items() for letter in "xyz"
}


@pytest.fixture(scope="module")
def unit():
    return calibrated(TRUTHS, "WN + FN")


FLAT = 2 * math.log(2) / math.pi
"""Allan variance of flicker noise at B = 1."""
OTHERS = ("matlab", *MARKOV)


@pytest.mark.slow
@pytest.mark.parametrize("format", sorted(set(CONSUMERS) - set(OTHERS)))
def test_the_walk_predicts_best(unit, format):
    text = unit.export(format=format, horizon=2.0)
    read = CONSUMERS[format](text)
    for sensor, b2 in list(B2.items())[format == "glim" :]:  # GLIM has one number for both sensors
        numbers = filter_numbers(gmwm.Model.parse(TRUTHS[f"{sensor}_x"]).processes, RATE, 2.0)
        assert read[sensor][1] == pytest.approx(numbers.K, rel=1e-4)
        # Near to the limit 2B²/(πN) of a short horizon, and far below the walk with the same Allan deviation at 2 s.
        limit = 2 * b2 / (math.pi * math.sqrt(1000 * b2 / RATE))
        assert 0.7 * limit < numbers.K < limit
        assert 0.5 * math.sqrt(3 * FLAT * b2 / 2.0) > numbers.K
    assert not [one for one in remarks_in(unit, format, horizon=2.0) if one.code != "bias-not-known"]
    assert "full model's" in words(text)


@pytest.mark.slow
@pytest.mark.parametrize("format", MARKOV)
def test_a_gauss_markov_bias_is_near_to_it(unit, format):
    exporter = find_exporter(format)
    options = {"axes": None, "inflation": 1.0, "horizon": 2.0, "rate": None, "duration": None}
    noise = exporter._noise(unit, _options(exporter, options))
    found, numbers = exporter.biases(noise), {axis.axis: axis.N for each in noise.sensors for axis in each.axes}
    text = words(unit.export(format=format, horizon=2.0))
    stated, errors = float(re.search(r"within (\S+) % of the model's", text)[1]), []
    n = np.unique(np.geomspace(2 * RATE, SAMPLES, 200).astype(int))
    for axis, bias in found.items():
        whole = gmwm.Model.parse(TRUTHS[axis])
        white = gmwm.WN(sigma2=RATE * numbers[axis].value ** 2)
        reduced = gmwm.Model((white, GM(beta=1 / bias.time, sigma2=bias.sigma.value**2)))
        ratio = np.sqrt(reduced.allan_variance(n, RATE) / whole.allan_variance(n, RATE))
        errors.append(100 * np.max(np.abs(ratio - 1)))
    assert max(errors) == pytest.approx(stated, rel=0.1)
    assert stated < 50
    assert not remarks_in(unit, format, horizon=2.0) or format in ("gnss-ins-sim", "navego")


@pytest.mark.slow
def test_matlab_has_a_parameter_for_it(unit):
    text = unit.export(format="matlab", inflation=2.0)
    code = "\n".join(line for line in text.splitlines() if not line.startswith("%"))
    for maker, b2 in (("gyroparams", B2["gyro"]), ("accelparams", B2["accel"])):
        call = code[code.index(maker) :]
        walk, flicker = (
            [float(x) for x in re.search(rf"'{key}', \[([^\]]*)\]", call)[1].split()]
            for key in ("RandomWalk", "BiasInstability")
        )
        assert walk == [0.0] * 3
        assert flicker == pytest.approx([2 * math.sqrt(b2)] * 3, rel=1e-4)
    assert code.count("fractalcoef(poles, 1)") == 2
    assert "poles = 20000;" in code
    assert "N and K do not include it" in words(text)
    assert not {"upper-limit:axis", "upper-limit:mean"} & {code_of(remark) for remark in remarks_in(unit, "matlab")}


@pytest.mark.slow
def test_the_filter_of_matlab_holds_flicker_noise_as_long_as_is_said():
    # 1/A(z) of Kasdin, with as many poles as the file asks for.
    k = np.arange(1, 20_001)
    gain = 1 / np.abs(np.fft.rfft(np.concatenate([[1.0], np.cumprod((k - 1.5) / k)]), 2**22)) ** 2
    f = np.arange(1, gain.size) / 2**22
    for n in (20, 200, 2000, 10_000):
        haar = np.sin(np.pi * n * f) ** 4 / (n * np.sin(np.pi * f)) ** 2
        assert 4 * np.sum(gain[1:] * haar) / 2**22 == pytest.approx(FLAT, rel=0.05)


def test_ros_leaves_it_out_and_says_so(unit):
    found = [remark for remark in remarks_in(unit, "ros") if code_of(remark) == "not-in-file:variance"]
    assert [(remark.subject, remark.facts["terms"]) for remark in found] == [(axis, ("FN",)) for axis in TRUTHS]


@pytest.mark.slow
def test_matrices_state_the_error_of_the_approximation(unit):
    found = [one for one in remarks_in(unit, "state-space") if one.code == "approximated"]
    assert [(one.subject, one.facts["terms"]) for one in found] == [(axis, ("FN",)) for axis in TRUTHS]
    assert all(one.facts["error"].value < 1.0 for one in found)
    for format in set(export_formats()) - {"dlio"}:
        assert unit.export(format=format)
