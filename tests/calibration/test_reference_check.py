"""One calibration beside a reference: the factor and the verdict of each number, in the convention of a file."""

import json
import math

import numpy as np
import pytest

import gmwm
from gmwm import Signal
from gmwm.base.errors import OptionError, UnitError
from gmwm.calibration.reference_check import _cause, _row
from gmwm.choosing.datasheets import Entry
from gmwm.files.importers import given_noise
from gmwm.recording.signals import Imu
from gmwm.showing.exporters.given import given_calibration
from tests.exporters.consumers import CONSUMERS
from tests.helpers import code_of, only, raises

RATE = 100.0
N = {"gyro": 1e-4, "accel": 1e-3}
K = {"gyro": 2e-6, "accel": 3e-5}


@pytest.mark.parametrize(
    ("reference", "verdict"), [(1.0, "agrees"), (1.08, "close"), (1.15, "larger"), (0.92, "close"), (0.85, "smaller")]
)
def test_a_reference_within_10_per_cent_is_close(reference, verdict):
    measured = Entry(symbol="N", title="", value=1.0, low=0.99, high=1.01, unit="rad/s/√Hz", upper_only=False)
    assert _row("gyro_x", "N", reference, measured).verdict == verdict


@pytest.mark.parametrize(("rate", "cause"), [(6.25, None), (16.0, "rate"), (1 / 6.25, None)])
def test_a_wrong_unit_is_suspected_from_a_factor_of_three(rate, cause):
    measured = Entry(symbol="N", title="", value=1.0, low=0.99, high=1.01, unit="rad/s/√Hz", upper_only=False)
    assert _cause(_row("gyro_x", "N", math.sqrt(rate), measured), rate) == cause


@pytest.fixture(scope="module")
def calibration():
    truth = {f"{s}_{x}": f"WN(sigma2={N[s] ** 2 * RATE!r}) + RW(gamma2={K[s] ** 2 / RATE!r})" for s in N for x in "xyz"}
    imu = gmwm.simulate(truth, rate=RATE, samples=100_000, rng=3)
    return gmwm.calibrate(imu, within="WN + RW")


def file_of(folder, format, size):
    """A file of a given unit whose densities are `size` times the truth."""
    text = "; ".join(
        f"{s}: N={size * N[s]!r}{u}/√Hz, K={size * K[s]!r}{u}/√s" for s, u in (("gyro", "rad/s"), ("accel", "m/s²"))
    )
    content = given_calibration(given_noise(text, RATE)).export(format=format)
    (folder / f"{format}.txt").write_text(content, encoding="utf-8")
    return folder / f"{format}.txt", content


@pytest.mark.slow
@pytest.mark.parametrize("format", ["kalibr", "vins", "fastlio", "orbslam3", "px4"])
@pytest.mark.parametrize("size", [1.0, 0.2])
def test_the_factor_is_that_of_the_file_in_any_convention(calibration, format, size, tmp_path):
    file, content = file_of(tmp_path, format, size)
    found = calibration.agree(file)
    assert len(found.rows) == 12
    for row in found:
        truth = (N if row.symbol == "N" else K)[row.axis.rpartition("_")[0]]
        assert row.reference == pytest.approx(size * truth, rel=1e-5)
        assert 1 / row.ratio == pytest.approx(size, rel=0.05 if row.symbol == "N" else 0.8)
        if size == 1.0:
            refused = calibration.number_verdicts[row.axis][row.symbol].usability.value == "do not use"
            assert row.verdict in (("unusable",) if refused else ("agrees", "close"))
        elif row.symbol == "N":
            assert row.verdict == "smaller"
        # The measured value in the convention of the file gives the measured density by the rule of the consumer.
        value = row.as_written
        if format in ("vins", "fastlio", "kalibr"):
            replaced = content.replace(f"{row.key}: {row.written:.6e}", f"{row.key}: {value!r}")
            if replaced != content:
                read = dict(zip(("N", "K"), _consumed(format, replaced)[row.axis[:-2]], strict=True))[row.symbol][0]
                wanted = row.measured.high if row.measured.upper_only else row.measured.value
                assert read == pytest.approx(wanted, rel=1e-5)
    codes = {code_of(remark) for remark in found.remarks}
    assert codes == {"reference-verdict"}


def _consumed(format, text):
    return CONSUMERS[format](text, rate=RATE) if format in ("vins", "fastlio") else CONSUMERS[format](text)


def test_values_of_samples_instead_of_densities_are_named(calibration, tmp_path):
    (tmp_path / "f.yaml").write_text(
        f"gyroscope_noise_density: {N['gyro'] * math.sqrt(RATE)}\ngyroscope_random_walk: {K['gyro']}\n"
        "update_rate: 100\n"
    )
    remark = only(calibration.agree(tmp_path / "f.yaml").remarks, "reference-factor")
    assert remark.facts["cause"] == "rate"
    assert remark.facts["numbers"] == ("N of gyro_x", "N of gyro_y", "N of gyro_z")
    degrees = calibration.agree({"gyro.N": (N["gyro"] * 180 / math.pi, "rad/s/√Hz")})
    assert only(degrees.remarks, "reference-factor").facts["cause"] in ("hour", "degree")


def test_numbers_of_a_datasheet(calibration):
    found = calibration.agree({"gyro.N": (2 * N["gyro"], "rad/s/√Hz"), "gyro_y.N": (N["gyro"], "rad/s/√Hz")})
    assert [row.verdict for row in found] == ["larger", found["gyro_y.N"].verdict, "larger"]
    assert found["gyro_y.N"].verdict in ("agrees", "close")
    text = calibration.agree("gyro: N=1deg/√h; accel_x: K=1m/s²/√s")
    assert [f"{row.axis}.{row.symbol}" for row in text] == ["gyro_x.N", "gyro_y.N", "gyro_z.N", "accel_x.K"]
    assert text.remarks[0].facts["state"] == "datasheet-larger"
    assert "gyro_x N" in text.summary()


def test_an_upper_limit_agrees_with_less_and_not_with_more():
    imu = gmwm.simulate({"gyro_x": "WN(sigma2=1e-6)"}, rate=RATE, samples=50_000, rng=5)
    found = gmwm.calibrate(imu, within="WN + RW")
    high = gmwm.datasheets.effective_noise(found["gyro_x"], 1.0)["K"].high
    for size, verdict in ((0.1, "agrees"), (10.0, "larger")):
        given = given_noise(f"gyro_x: N=1e-4rad/s/√Hz, K={size * high!r}rad/s/√s", RATE)
        checked = found.agree({"gyro_x.N": (1e-4, "rad/s/√Hz")})
        assert checked["gyro_x.N"].verdict in ("agrees", "close")
        from dataclasses import replace

        row = found.agree(replace(given, written={"gyro_x": {"K": ("gyr_w", 1.0), "N": ("gyr_n", 1.0)}}))["gyro_x.K"]
        assert row.verdict == verdict
        assert row.ratio == pytest.approx(1 / size, rel=1e-6)


def test_a_file_is_compared_with_the_numbers_of_the_datasheet(calibration, tmp_path):
    """Their intervals include the choice of the model, and their limits the remarks, as in exported files."""
    file, _ = file_of(tmp_path, "kalibr", 1.0)
    for row in calibration.agree(file):
        assert row.measured == calibration.datasheets[row.axis][row.symbol]
    limits = {(row.axis, row.symbol) for row in calibration.agree(file) if row.measured.upper_only}
    longer = calibration.agree(file, horizon=2.0)
    assert limits <= {(row.axis, row.symbol) for row in longer if row.measured.upper_only}
    assert longer["gyro_x.N"].measured != calibration.datasheets["gyro_x"]["N"]


def test_the_summary_states_the_rate_for_which_a_file_is_read(calibration, tmp_path):
    file, _ = file_of(tmp_path, "vins", 1.0)
    assert "vins.txt (VINS, 100 Hz)" in calibration.agree(file).summary()
    fast = calibration.agree(given_noise(file, 400.0))
    assert "vins.txt (VINS, 400 Hz)" in fast.summary()
    assert fast["gyro_x.N"].reference == pytest.approx(N["gyro"] / 2, rel=1e-6)


def test_documents_and_errors(calibration, tmp_path):
    file, _ = file_of(tmp_path, "vins", 1.0)
    content = json.loads(json.dumps(calibration.agree(file).to_dict()))
    assert len(content["rows"]) == 12
    assert np.isfinite(content["rows"][0]["as_written"])
    with raises(OptionError, argument="reference"):
        calibration.agree({"gyro.X": (1.0, "deg/h")})
    with raises(UnitError, argument="reference"):
        calibration.agree({"gyro.N": (1.0, "deg/h")})
    with raises(OptionError, argument="source"):
        calibration.agree("nothing.yaml")


def test_a_number_that_must_not_be_used_is_not_compared():
    x = np.random.default_rng(1).normal(0, 1e-3, 60_000)
    imu = Imu({"gyro_x": Signal(np.minimum(x, 0.0), RATE, "rad/s", axis="gyro_x")})
    check = gmwm.calibrate(imu, "WN + RW").agree({"gyro.N": (1e-4, "rad/s/√Hz")})
    assert [row.verdict for row in check] == ["unusable"]
    assert check.of("larger") == ()
    assert "better" not in check.summary()
    assert "do not use" in check.summary()
