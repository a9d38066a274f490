"""What a file says of numbers that are not what they look like: models that fail, limits among measured values."""

import json
import math
import re
from dataclasses import replace

import numpy as np
import pytest

import gmwm
from gmwm.base.remarks import Quantity, Severity, texts
from gmwm.base.remarks.registry import messages
from gmwm.base.remarks.rendering import cases
from gmwm.calibration.findings import rejected_axes
from gmwm.calibration.misfit import misfit_of
from gmwm.calibration.number_verdicts import Usability
from gmwm.showing.exporters import export_all, export_formats
from gmwm.showing.exporters.base import find_exporter
from gmwm.showing.exporters.quality import verdict
from tests.helpers import code_of, each, only

from .conftest import TRUTHS, calibrated, exact_curve, remarks_in, words
from .consumers import CONSUMERS, MARKOV, PER_AXIS

HUMP = "GM(beta=20.0, sigma2=1e-5) + WN(sigma2=6e-7)"
"""No sum of white noise and a random walk has such a curve."""


@pytest.fixture(scope="module")
def bad():
    return calibrated({**TRUTHS["no-walk"], "gyro_z": HUMP, "accel_x": HUMP}, "WN + RW")


@pytest.mark.slow
@each("format", sorted(set(export_formats()) - {"dlio"}))
def test_axes_that_do_not_fit_their_models_are_in_every_file(bad, format):
    found = [remark for remark in remarks_in(bad, format) if remark.severity is Severity.UNUSABLE]
    assert [(code_of(remark), remark.subject) for remark in found] == [
        ("model-misfit", "gyro_z"),
        ("model-misfit", "accel_x"),
    ]
    text = bad.export(format=format)
    if format == "json":
        assert [one["subject"] for one in json.loads(text)["remarks"] if one["severity"] == "unusable"] == [
            "gyro_z", "accel_x"
        ]  # fmt: skip
    else:
        cautions = [f"CAUTION: {one}" for one in texts(found)]
        assert cautions
        assert all(words(one) in words(text) for one in cautions)


def test_they_are_the_axes_that_cannot_be_used(bad):
    for axis in ("gyro_z", "accel_x"):
        remark = next(remark for remark in bad.remarks if (remark.code, remark.subject) == ("model-misfit", axis))
        assert set(remark.facts["numbers"]) & {"N", "K", "B"}
        for symbol, one in bad.number_verdicts[axis].items():
            refused = one.usability is Usability.DO_NOT_USE and one.reason == remark
            assert refused == (symbol.partition(" of ")[0] in remark.facts["numbers"]), symbol
    for remark in remarks_in(bad, "kalibr"):
        if remark.code == "model-misfit":
            far = misfit_of(bad.axes[remark.subject])
            assert (remark.facts["ratio"], remark.facts["tau"]) == (far.times, Quantity(far.tau, "s"))
            assert remark.facts["side"] == ("above" if far.ratio > 1 else "below")


def refused_in(text, calibration):
    """The numbers that the verdict of a file says not to use."""
    stop = re.search(r"Verdict: DO NOT USE (.*?) until the cause is found", words(text))
    refused = set()
    for part in re.split(r", (?=[NKB] of )| and (?=[NKB] of )", stop[1] if stop else ""):
        symbols, axes = part.split(" of ") if " of " in part else ("NKB", part)
        names = calibration.axes if axes == "this file" else re.findall(r"\w+_[xyz]", axes)
        refused |= {(symbol, axis) for symbol in symbols for axis in names}
    return refused


def refused_by_table(calibration):
    return {
        (symbol, axis)
        for axis, of_axis in calibration.number_verdicts.items()
        for symbol, one in of_axis.items()
        if symbol in ("N", "K", "B") and one.usability is Usability.DO_NOT_USE
    }


@pytest.mark.slow
def test_a_file_refuses_the_numbers_that_the_table_refuses(units):
    """For every message, on one axis, on one sensor and on the recording."""
    unit, kinds = units["quantized"], set()
    for message in messages().values():
        for remark in (replace(remark, subject=name) for remark in cases(message) for name in ("", "gyro_x", "accel")):
            found = replace(unit, recording_remarks=(remark,))
            table = refused_by_table(found)
            assert refused_in(verdict(found), found) == table, (code_of(remark), remark.subject)
            kinds.add(len(table))
    assert len(kinds) > 4


@pytest.mark.slow
@each("format", CONSUMERS)
def test_a_file_with_a_model_that_fails_refuses_as_its_table(bad, format):
    table = refused_by_table(bad)
    assert refused_in(bad.export(format=format), bad) == table != set()


@pytest.mark.slow
def test_a_rejected_model_that_follows_its_curve_is_no_caution():
    # 20 % off is far more than chance, and less than the ratio of 1.5 of a misfit.
    curve = exact_curve("gyro_z", TRUTHS["no-walk"]["gyro_x"])
    factor = np.where(curve.levels % 2, 1.2, 1.0)
    wave = replace(curve, **{name: getattr(curve, name) * factor for name in ("variance", "lower", "upper")})
    found = calibrated(TRUTHS["no-walk"], "WN + RW")
    axes = {**found.axes, "gyro_z": gmwm.calibrate({"gyro_z": wave}, "WN + RW").axes["gyro_z"]}
    found = replace(found, axes=axes)
    assert rejected_axes(found) == ["gyro_z"]
    assert "CAUTION" not in found.export()
    assert json.loads(found.export(format="json"))["remarks"] == []


# White noise so large on gyro_z that its limit of K lies above what the others have; on accel_x it lies far below.
MIXED = {**TRUTHS["quantized"], "gyro_z": "WN(sigma2=5e-2)", "accel_x": "WN(sigma2=2e-5)"}


@pytest.fixture(scope="module")
def mixed():
    return calibrated(MIXED)


def among(remarks):
    """Axis, kind and value of the remarks on numbers of measured values and upper limits, by number."""
    found = {}
    for remark in remarks:
        if code_of(remark) == "upper-limit:mean":
            value = remark.facts["value"]
            one = (remark.subject, remark.facts["kind"], value.unit, value.value)
            found.setdefault(remark.facts["number"], []).append(one)
    return found


@pytest.mark.slow
@each("format", CONSUMERS)
def test_a_limit_among_measured_values_names_its_axis(mixed, format):
    text = mixed.export(format=format, axes="worst")
    limit = float(mixed.export(format="matlab").split("'RandomWalk', [")[1].split("]")[0].split()[2])
    found = [one for one in remarks_in(mixed, format, axes="worst") if one.code != "bias-not-known"]
    # The limit of gyro_z is the largest K, and its white noise the largest N.
    assert only(found, "upper-limit:axis").subject == "K of gyro_z"
    assert words(text).count("UPPER LIMIT, not a measured value (97.5 %): K of gyro_z.") == 1
    assert "N of gyro_z, K of gyro_z (upper limit)" in words(text)
    white, walk = CONSUMERS[format](text)["gyro"]
    assert white == pytest.approx(math.sqrt(5e-2 / 200.0), rel=1e-4)
    if format not in MARKOV:
        assert walk == pytest.approx(limit, rel=2e-6)


@pytest.mark.slow
def test_the_values_in_remarks_are_not_inflated(mixed):
    assert remarks_in(mixed, "kalibr", inflation=1.0) == remarks_in(mixed, "kalibr", inflation=10.0)


@each("format", CONSUMERS)
def test_a_mean_with_a_limit_names_the_axes(mixed, format):
    found = remarks_in(mixed, format, axes="mean")
    kinds = {number: [one[:2] for one in axes] for number, axes in among(found).items()}
    assert kinds == {
        "K of the gyroscopes": [("gyro_x", "measured"), ("gyro_y", "measured"), ("gyro_z", "upper limit")],
        "K of the accelerometers": [("accel_x", "upper limit"), ("accel_y", "measured"), ("accel_z", "measured")],
    }
    value = among(found)["K of the accelerometers"][1]
    assert value[2:] == ("m/s²/√s", pytest.approx(1.414e-4, rel=5e-3))
    assert "upper-limit:axis" not in {code_of(remark) for remark in found}


@pytest.mark.slow
def test_limits_of_all_axes_and_of_some_are_told_apart():
    unit = calibrated({**MIXED, "accel_y": "WN(sigma2=3e-5)", "accel_z": "WN(sigma2=4e-5)"})
    found = remarks_in(unit, "kalibr", axes="mean")
    assert only(found, "upper-limit:axis").subject == "K of the accelerometers"
    assert list(among(found)) == ["K of the gyroscopes"]


@pytest.mark.parametrize("format", PER_AXIS)
def test_each_axis_has_its_own_limit(mixed, format):
    found = remarks_in(mixed, format, axes="each")
    limits = [remark for remark in found if code_of(remark) == "upper-limit:axis"]
    assert [remark.subject for remark in limits] == ["K of gyro_z", "K of accel_x"]
    assert among(found) == {}
    text = words(mixed.export(format=format, axes="each"))
    assert text.count("UPPER LIMIT, not a measured value (97.5 %): K of gyro_z, K of accel_x.") == 1


RATE = 200.00116000672804


@pytest.mark.parametrize("format", sorted(f for f in CONSUMERS if "rate" in find_exporter(f).takes))
def test_rates_have_six_digits_and_numbers_the_rate_itself(units, format):
    text = units["quantized"].export(format=format, rate=RATE)
    assert "200.0011" not in text
    has_none = format in ("gtsam", "gtsam-python", "liosam")
    assert len(re.findall(r"\b200\.001\b", text)) == (0 if has_none else 1)
    if format in ("vins", "fastlio"):
        key, power = {"vins": ("acc_n", 0.5), "fastlio": ("acc_cov", 1.0)}[format]
        ratio = [float(re.search(rf"{key}: (\S+)", one)[1]) for one in (text, units["quantized"].export(format=format))]
        assert ratio[0] / ratio[1] == pytest.approx((RATE / 200.0) ** power, rel=1e-6)


def test_json_keeps_all_digits_of_a_rate(units):
    calibration = units["quantized"]
    found = calibration.axes["gyro_x"]
    wave = replace(found.fit.wavelet_variance, rate=RATE)
    told = replace(
        calibration, axes={**calibration.axes, "gyro_x": replace(found, fit=replace(found.fit, wavelet_variance=wave))}
    )
    assert json.loads(told.export(format="json"))["axes"]["gyro_x"]["rate"] == RATE


def test_all_formats_at_once_have_the_cautions(bad, tmp_path):
    written, left = export_all(bad, tmp_path)
    assert set(left) == {"dlio"}  # the unit was calibrated from curves and has no bias
    caution = texts(remark for remark in bad.remarks if remark.code == "model-misfit")
    for format, path in written.items():
        if format != "json":
            assert all(words(one) in words(path.read_text(encoding="utf-8")) for one in caution), format
    assert math.isfinite(json.loads(written["json"].read_text(encoding="utf-8"))["horizon"])


@pytest.mark.slow
def test_a_ramp_in_matrices_is_a_caution():
    drifting = {**TRUTHS["no-walk"], "gyro_z": "WN(sigma2=1e-6) + DR(omega=1e-6)"}
    calibration = calibrated(drifting, "WN + DR")
    remark = only(remarks_in(calibration, "state-space"), "ramp-in-matrices")
    assert (remark.subject, remark.facts["term"]) == ("gyro_z", "DR")
    assert f"CAUTION: {words(remark.text())}" in words(calibration.export(format="state-space"))
    none = remarks_in(calibrated(TRUTHS["no-walk"], "WN + RW"), "state-space")
    assert "ramp-in-matrices" not in {remark.code for remark in none}
