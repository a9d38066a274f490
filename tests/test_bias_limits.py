"""An upper limit of the bias instability does not lie below the data, whatever the model is."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest

import gmwm
from gmwm import GM, RW, WN, Signal, WaveletVariance
from gmwm.choosing.datasheets import Datasheet

pytestmark = pytest.mark.filterwarnings("ignore::gmwm.errors.FitWarning")

RATE = 100.0
FLOOR = math.sqrt(2 * math.log(2) / math.pi)
SLOW = WN(sigma2=6e-7) + GM(beta=2.0, sigma2=1e-7) + GM(beta=0.03, sigma2=1.5e-8)


def exact(model: gmwm.Model = SLOW, filter: str = "haar", unit: str = "rad/s") -> WaveletVariance:
    """The wavelet variance of a model itself, as if it had been measured."""
    values = model.wavelet_variance(13, RATE, filter)
    return WaveletVariance.from_values(values, samples=2**17, rate=RATE, unit=unit, filter=filter)


def sheet(model: str, wv: WaveletVariance) -> Datasheet:
    return gmwm.fit(model, wv).datasheet()


def by_data(found: Datasheet) -> bool:
    return any(remark.code == "b-limit" and remark.facts["source"] == "data" for remark in found.remarks)


def test_the_limit_is_that_of_the_data():
    wv = exact()
    found = sheet("WN", wv)
    at = int(np.argmin(wv.upper))
    assert by_data(found)
    assert found["B"].upper_only
    assert found["B"].low == 0
    assert found["B"].high == pytest.approx(math.sqrt(2 * wv.upper[at]) / FLOOR, rel=1e-9, abs=0)
    assert found["B"].high > math.sqrt(2 * float(wv.lower.min())) / FLOOR > found["B"].value
    assert Datasheet.from_dict(json.loads(json.dumps(found.to_dict(), allow_nan=False))).summary() == found.summary()


def test_a_right_model_has_no_say_beyond_what_the_data_show():
    wv = exact(gmwm.Model((WN(sigma2=6e-7),)))
    found = sheet("WN", wv)
    assert by_data(found)
    assert found["B"].high == pytest.approx(math.sqrt(2 * float(wv.upper.min())) / FLOOR, rel=1e-9, abs=0)


@pytest.mark.parametrize("factor", [1e-6, 1e6])
def test_the_unit_changes_nothing(factor):
    wv = exact()
    other = replace(wv, variance=wv.variance * factor, lower=wv.lower * factor, upper=wv.upper * factor)
    a, b = sheet("WN", wv), sheet("WN", other)
    assert by_data(b)
    assert b["B"].high == pytest.approx(a["B"].high * math.sqrt(factor), rel=1e-9, abs=0)


@pytest.mark.slow
def test_with_another_filter_the_data_still_set_it():
    a, b = sheet("WN", exact()), sheet("WN", exact(filter="d4"))
    assert by_data(b)
    # Another filter has other limits and another shape, but the same noise.
    assert b["B"].high == pytest.approx(a["B"].high, rel=0.5, abs=0)


def test_a_level_of_zero_says_nothing():
    wv = exact()
    none = np.where(wv.levels == 1, 0.0, 1.0)
    wv = replace(wv, variance=wv.variance * none, lower=wv.lower * none, upper=wv.upper * none)
    a, b = (gmwm.fit("WN", data, weighting="identity").datasheet() for data in (exact(), wv))
    assert by_data(b)
    assert b["B"].high == pytest.approx(a["B"].high, rel=1e-9, abs=0)


def test_beyond_the_levels_that_were_kept_the_data_say_nothing():
    wv = exact(gmwm.Model((RW(gamma2=1e-10),)))
    kept = {name: getattr(wv, name)[5:] for name in ("levels", "variance", "lower", "upper", "counts")}
    found = sheet("RW", replace(wv, **kept))
    assert found["B"].tau == 1 / RATE
    assert found["B"].high < math.sqrt(2 * wv.lower[5]) / FLOOR
    assert not by_data(found)


FLICKER = gmwm.Model.parse("WN(sigma2=6e-7) + FN(b2=4e-10)")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("truth", "model"),
    [(WN(sigma2=6e-7) + GM(beta=0.2, sigma2=2e-8), "GM + WN"), (SLOW, "GM + WN"), (FLICKER, "2*GM + WN")],
    ids=["right", "wrong", "flicker"],
)
def test_limits_of_right_and_of_wrong_models_hold_the_truth(truth, model):
    paths, samples = 30, 2**15
    times = 2 ** np.arange(int(math.log2(samples)))
    lowest = math.sqrt(float(truth.allan_variance(times, RATE).min())) / FLOOR
    held = 0
    for x in truth.simulate(samples, RATE, rng=11, paths=paths):
        found = gmwm.fit(model, Signal(x, RATE, "rad/s"), certify=False).datasheet()
        held += found["B"].high >= lowest
    # Of 30 at 97.5 %, fewer than 26 would come by chance once in a thousand times.
    assert held >= 26
