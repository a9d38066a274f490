"""Every file is read back by its consumer's own rules, and gives the N and K of the model."""

import csv
import json
import math
import re
from pathlib import Path

import numpy as np
import pytest

import gmwm
from gmwm.base.remarks import Quantity
from gmwm.choosing.datasheets.filter_numbers import filter_numbers
from gmwm.files.importers import given_noise
from gmwm.showing.exporters import export_formats
from gmwm.theory.processes import Model
from tests.helpers import code_of, each, only, raises

from .conftest import RATE, SAMPLES, TRUTHS, as_golden, calibrated, remarks_in, words
from .consumers import BIASES, CONSUMERS, MARKOV, PER_AXIS, yaml

GOLDEN = Path(__file__).parent / "golden"
HORIZON = 1.0
SPACES = ("state-space", "state-space-json", "state-space-matlab", "state-space-cpp")
FULL = ("json", "csv", "latex", *SPACES)
NUMBER = re.compile(r"(?<![\w.])[-+]?(?:\d+\.\d*|\d+)(?:e[-+]?\d+)?(?![\w.])")


def of_model(truth, horizon=HORIZON):
    """N and K of a model, with the intervals of the recording left aside."""
    numbers = filter_numbers(Model.parse(truth).processes, RATE, horizon, slowest=SAMPLES / 10)
    return numbers.N, numbers.K


def expected(truths, rule, horizon=HORIZON):
    rules = {
        "worst": lambda v: [max(v)] * 3,
        "mean": lambda v: [math.sqrt(np.mean(v**2))] * 3,
        "each": lambda v: v,
    }
    found = {}
    for sensor in ("gyro", "accel"):
        three = np.array([of_model(truths[f"{sensor}_{letter}"], horizon) for letter in "xyz"]).T
        found[sensor] = tuple(np.array(rules[rule](values)) for values in three)
    return found


def test_every_format_has_a_consumer_here():
    assert {*CONSUMERS, *BIASES, "ros", *FULL} == set(export_formats())


@pytest.mark.slow
@each("rule", ["worst", "mean", "each"])
@each("format", CONSUMERS)
def test_consumers_read_n_and_k_back(unit, format, rule):
    name, calibration = unit
    if rule == "each" and format not in PER_AXIS:
        with raises(gmwm.errors.OptionError, argument="axes", got="each"):
            calibration.export(format=format, axes=rule)
        return
    text = calibration.export(format=format, axes=rule)
    wanted = expected(TRUTHS[name], rule)
    if format == "glim":  # one number for both sensors
        wanted = {sensor: (white, wanted["accel"][1]) for sensor, (white, _) in wanted.items()}
    for sensor, (white, walk) in wanted.items():
        found_white, found_walk = CONSUMERS[format](text)[sensor]
        assert found_white == pytest.approx(white, rel=2e-6)
        if name == "no-walk":
            # An upper limit, which the file says: see below.
            assert np.all(found_walk > 0)
        elif format not in MARKOV:
            assert found_walk == pytest.approx(walk, rel=2e-6)
    assert ("UPPER LIMIT" in text) == (name == "no-walk")


@each("format", CONSUMERS)
def test_inflation_scales_n_and_k(units, format):
    calibration = units["quantized"]
    plain = CONSUMERS[format](calibration.export(format=format))
    text = calibration.export(format=format, inflation=10.0)
    inflated = CONSUMERS[format](text)
    for sensor, pair in plain.items():
        for before, after in zip(pair, inflated[sensor], strict=True):
            assert after == pytest.approx(10 * before, rel=2e-6)
    assert "Inflation factor: 10" in text


@pytest.mark.slow
@pytest.mark.parametrize("format", sorted(set(CONSUMERS) - {*MARKOV, "glim"}))
def test_the_horizon_sets_the_time_of_the_prediction(units, format):
    calibration, truths = units["gauss-markov"], TRUTHS["gauss-markov"]
    text = calibration.export(format=format, horizon=30.0)
    for sensor, pair in expected(truths, "each" if format in ("matlab", "basalt") else "worst", 30.0).items():
        for found, wanted in zip(CONSUMERS[format](text)[sensor], pair, strict=True):
            # K of the axes with short correlation times is zero over 30 s, and an upper limit in the file.
            assert found[wanted > 0] == pytest.approx(wanted[wanted > 0], rel=2e-6)
    assert "Horizon: 30 s" in words(text)


def test_worst_is_the_largest_n_and_the_largest_k(units):
    calibration = units["gauss-markov"]
    sheets = calibration.datasheets
    for sensor in ("gyro", "accel"):
        white, walk = CONSUMERS["kalibr"](calibration.export())[sensor]
        assert white[0] == pytest.approx(max(sheets[f"{sensor}_{k}"]["N"].value for k in "xyz"), rel=1e-6)
        assert walk[0] == pytest.approx(max(sheets[f"{sensor}_{k}"]["K"].value for k in "xyz"), rel=1e-6)
    assert "Gyroscopes: N of gyro_y, K of gyro_z, the largest of gyro_x" in words(calibration.export())
    # A limit that is the largest number counts, and the file says so.
    text = units["no-walk"].export()
    assert "K of gyro_z (upper limit), the largest of" in words(text)
    limit = max(sheet["K"].high for axis, sheet in units["no-walk"].datasheets.items() if axis.startswith("gyro"))
    assert CONSUMERS["kalibr"](text)["gyro"][1][0] == pytest.approx(limit, rel=1e-6)


@each("format", CONSUMERS)
def test_the_file_has_the_numbers_of_the_table(units, format):
    axes = "each" if format in PER_AXIS else "worst"
    for calibration in units.values():
        consumed = CONSUMERS[format](calibration.export(format=format, axes=axes))
        for sensor in ("gyro",) if format == "glim" else ("gyro", "accel"):
            for symbol, found in zip("NK", consumed[sensor], strict=True):
                entries = [calibration.datasheets[f"{sensor}_{k}"][symbol] for k in "xyz"]
                values = [entry.high if entry.upper_only else entry.value for entry in entries]
                if format not in (*MARKOV, "glim") or symbol == "N":
                    assert found == pytest.approx(values if axes == "each" else [max(values)] * 3, rel=2e-6)


@each("format", MARKOV)
def test_a_bias_of_an_upper_limit_walks_by_this_limit(format):
    """Also if the program has one T for all axes, which comes from an axis with a measured bias."""
    mixed = TRUTHS["no-walk"] | {"gyro_x": TRUTHS["gauss-markov"]["gyro_x"]}
    calibration = calibrated(mixed)
    consumed = CONSUMERS[format](calibration.export(format=format, axes="each"))
    for axis, sheet in calibration.datasheets.items():
        walk = consumed[axis[:-2]][1]["xyz".index(axis[-1])]
        if axis != "gyro_x":
            assert sheet["K"].upper_only
            assert walk == pytest.approx(sheet["K"].high, rel=2e-6)


@each("format", ["kalibr", "vins", "fastlio", "orbslam3", "liosam", "kfgins", "px4", "ardupilot"])
def test_a_file_with_upper_limits_is_read_back(units, format, tmp_path):
    text = units["no-walk"].export(format=format)
    (tmp_path / "file").write_text(text, encoding="utf-8")
    values = given_noise(tmp_path / "file", RATE).values
    for sensor, (white, walk) in CONSUMERS[format](text).items():
        for k, letter in enumerate("xyz"):
            found = values[f"{sensor}_{letter}"]
            assert (found.N, found.K or found.sigma * math.sqrt(2 / found.time)) == pytest.approx((white[k], walk[k]))


@each("format", sorted(CONSUMERS))
def test_a_file_begins_with_its_verdict_and_has_few_comments(units, format):
    for calibration in units.values():
        text = calibration.export(format=format)
        if text.startswith("{"):
            content = json.loads(text)
            head, notes = content["gmwm"], content["gmwm_notes"]
            assert next(iter(content)) == ("value0" if format == "basalt" else "gmwm")
        else:
            lines = [line for line in text.splitlines() if not line.startswith("%YAML")]
            blank = lines.index("<imu>" if format == "gazebo" else "")
            head = [line for line in lines[:blank] if line not in ("<!--", "-->") and "stddev for" not in line]
            end = len(lines) - lines[::-1].index("<!--") if format == "gazebo" else len(lines) - lines[::-1].index("")
            notes = lines[end : -1 if format == "gazebo" else None]
        assert len(head) <= 3
        assert "Noise of an IMU for" in head[0]
        assert "Verdict: The calibration can be used." in head[1]
        assert len(notes) <= 15
        assert "report.html" in notes[-1]


@pytest.mark.parametrize("format", ["vins", "fastlio", "gazebo", "matlab"])
def test_discrete_numbers_are_for_the_rate_that_is_asked_for(units, format):
    text = units["quantized"].export(format=format, rate=400.0, axes="worst")
    for sensor, pair in expected(TRUTHS["quantized"], "worst").items():
        numbers = 1 if format in MARKOV else 2
        for found, wanted in list(zip(CONSUMERS[format](text, rate=400.0)[sensor], pair, strict=True))[:numbers]:
            assert found == pytest.approx(wanted, rel=2e-6)


@pytest.mark.slow
def test_a_walk_that_is_not_there_is_the_upper_limit_of_the_wider_model(units):
    fit = units["no-walk"]["accel_y"]
    with pytest.warns(gmwm.errors.FitWarning):
        wider = gmwm.fit("WN + RW", fit.wavelet_variance, weighting="optimal")
    limit = math.sqrt(wider.confidence_intervals()["RW.gamma2"][1] * RATE)
    walk = CONSUMERS["matlab"](units["no-walk"].export(format="matlab"))["accel"][1]
    assert walk[1] == pytest.approx(limit, rel=1e-3)
    text = units["no-walk"].export(format="matlab")
    found = [remark for remark in remarks_in(units["no-walk"], "matlab") if code_of(remark) == "upper-limit:axis"]
    assert [remark.subject for remark in found] == ["K of gyro_x, gyro_y, gyro_z", "K of accel_x, accel_y, accel_z"]
    assert {remark.facts["level"] for remark in found} == {Quantity(97.5, "%")}
    assert "UPPER LIMIT, not a measured value (97.5 %): K of gyro_x, gyro_y, gyro_z, K of accel_x" in words(text)


@pytest.mark.slow
def test_white_noise_that_is_not_there_is_an_upper_limit_too(units):
    truths = {**TRUTHS["quantized"], "gyro_x": "RW(gamma2=1e-9)", "gyro_y": "RW(gamma2=1e-9)"}
    calibration = calibrated({**truths, "gyro_z": "RW(gamma2=1e-9)"})
    text = calibration.export()
    assert only(remarks_in(calibration, "kalibr"), "upper-limit:axis").code == "upper-limit"
    white, walk = CONSUMERS["kalibr"](text)["gyro"]
    assert 0 < white[0] < walk[0]
    assert walk == pytest.approx(math.sqrt(1e-9 * RATE), rel=2e-6)


@pytest.mark.slow
@pytest.mark.parametrize("format", MARKOV)
def test_a_single_gauss_markov_term_is_nearly_the_bias_itself(format):
    truth = "GM(beta=0.1, sigma2={}) + WN(sigma2={})"
    truths = {f"{sensor}_{letter}": truth.format(scale * (1 + k), 1e2 * scale)
              for sensor, scale in (("gyro", 1e-8), ("accel", 1e-6)) for k, letter in enumerate("xyz")}  # fmt: skip
    text = calibrated(truths, "GM + WN").export(format=format, axes="each")
    found = CONSUMERS[format](text)
    for sensor, scale in (("gyro", 1e-8), ("accel", 1e-6)):
        assert found[sensor][1] == pytest.approx(np.sqrt(2 * 0.1 * scale * np.arange(1, 4)), rel=0.04)
    # N of the table, 2 to 4 % above the white noise, makes the difference.
    assert float(re.search(r"within (\S+) % of the model's", words(text))[1]) < 4


@pytest.mark.slow
def test_the_bias_of_kf_gins_is_as_large_as_the_bias():
    """The σ is that of the slow terms within the duration, and T is not longer than that."""
    truths = {axis: f"WN(sigma2={k}e-7) + RW(gamma2=1e-12)" for k, axis in enumerate(TRUTHS["no-walk"], 2)}
    calibration = calibrated(truths, "WN + RW")
    for duration, samples in ((None, SAMPLES), (100.0, 100 * RATE)):
        content = yaml(calibration.export(format="kfgins", duration=duration))["imunoise"]
        assert content["corrtime"] * 3600 == pytest.approx(samples / RATE, rel=1e-3)
        rms = math.sqrt(1e-12 * samples / 6)
        assert 0.5 < content["gbstd"][0] * math.pi / 180 / 3600 / rms < 2.5


def test_an_error_of_the_reduction_is_that_of_the_allan_deviation():
    """Flicker noise and a walk by one Gauss-Markov process: the stated error is the largest in the band."""
    truths = dict.fromkeys(TRUTHS["no-walk"], "WN(sigma2=2e-7) + RW(gamma2=1e-12)")
    text = calibrated(truths, "WN + RW").export(format="navego")
    stated = float(re.search(r"within (\S+) % of the model's", words(text))[1])
    assert "T of gyro_x, gyro_y" in words(text)
    white, sigma, time = (float(re.search(rf"imu.{key} = \[(\S+)", text)[1]) for key in ("arw", "gb_dyn", "gb_corr"))
    white, sigma = white * math.pi / 180 / 60, sigma * math.pi / 180
    n = np.unique(np.geomspace(RATE, SAMPLES, 200).astype(int))
    whole = Model.parse(truths["gyro_x"]).allan_variance(n, RATE)
    reduced = Model.parse(
        f"WN(sigma2={white**2 * RATE!r}) + GM(beta={1 / time!r}, sigma2={sigma**2!r})"
    ).allan_variance(n, RATE)
    assert 100 * np.max(np.abs(np.sqrt(reduced / whole) - 1)) == pytest.approx(stated, rel=0.1)


def test_gazebo_simulates_the_gauss_markov_term_itself(units):
    from xml.etree import ElementTree

    text = units["gauss-markov"].export(format="gazebo")
    imu = ElementTree.fromstring(re.sub(r"<!--.*?-->", "", text, flags=re.DOTALL))
    noise = imu.find("linear_acceleration/z/noise")
    time, drive = (float(noise.find(f"dynamic_bias_{key}").text) for key in ("correlation_time", "stddev"))
    space = gmwm.GM(beta=0.1, sigma2=3e-6).state_space(RATE)
    assert 1 - math.exp(-1 / (RATE * time)) == pytest.approx(1 - space.F[0, 0], rel=0.03)
    assert -(drive**2) * time / 2 * math.expm1(-2 / (RATE * time)) == pytest.approx(space.Q[0, 0], rel=0.05)


@pytest.mark.slow
@pytest.mark.parametrize("rule", ["worst", "mean", "each"])
def test_ros_covariances_are_the_variances_of_samples(unit, rule):
    name, calibration = unit
    content = yaml(calibration.export(format="ros", axes=rule, inflation=2.0))
    for sensor, key in (("gyro", "angular_velocity_covariance"), ("accel", "linear_acceleration_covariance")):
        three = []
        for letter in "xyz":
            found = [p.values for p in Model.parse(TRUTHS[name][f"{sensor}_{letter}"]).processes]
            three.append(sum(v.get("sigma2", 0.0) + 2 * v.get("q2", 0.0) for v in found))
        wanted = {"worst": [max(three)] * 3, "mean": [np.mean(three)] * 3, "each": three}[rule]
        matrix = np.array(content[key]).reshape(3, 3)
        assert np.diag(matrix) == pytest.approx(4 * np.array(wanted), rel=2e-6)
        assert np.count_nonzero(matrix) == 3


@each("format", CONSUMERS)
def test_the_head_says_what_the_numbers_are(units, format):
    text = units["no-walk"].export(format=format)
    head = words(text)
    units_of = {
        "kfgins": ("deg/h", "mGal"),
        "navego": ("deg/s", "mg"),
        "airsim": ("deg/h", "mg/sqrt(Hz)"),
        "gnss-ins-sim": ("deg/h", "m/s^2"),
    }
    units_of = units_of.get(format, ("rad/s", "m/s^2"))
    for said in (
        *units_of, "bench.csv", "400000 samples at 200 Hz", "Units: ", "Inflation factor: 1.", "Horizon: 1 s.",
        "of gyro_x, gyro_y, gyro_z", "of accel_x, accel_y, accel_z",
    ):  # fmt: skip
        assert said in head, said
    assert "continuous" in head.lower() or "discrete" in head.lower()
    assert text.isascii()
    assert max(map(len, text.splitlines())) <= 130


@each("format", sorted({*CONSUMERS, "autoware", "ros", "csv", "latex"}))
@each("name", TRUTHS)
def test_files_are_as_they_were(units, name, format):
    """Texts to the letter, numbers to 1e-5; `python -m tests.exporters.make_golden` writes them anew."""
    text = as_golden(units[name], format)
    kept = (GOLDEN / name / f"{format}.txt").read_text(encoding="utf-8")
    version = re.escape(f"gmwm {gmwm.__version__}")
    texts = [NUMBER.sub("#", re.sub(version, "gmwm", one)) for one in (text, kept)]
    assert texts[0].split() == texts[1].split()
    found, wanted = ([float(x) for x in NUMBER.findall(re.sub(version, "", one))] for one in (text, kept))
    assert found == pytest.approx(wanted, rel=1e-5)


@pytest.mark.slow
def test_csv_has_every_number_of_every_datasheet(unit):
    _, calibration = unit
    lines = [line for line in calibration.export(format="csv").splitlines() if line and not line.startswith("#")]
    rows = list(csv.DictReader(lines))
    entries = [(axis, e) for axis, sheet in calibration.datasheets.items() for e in sheet.entries]
    assert [(row["axis"], row["symbol"]) for row in rows] == [(axis, e.symbol) for axis, e in entries]
    for row, (_, entry) in zip(rows, entries, strict=True):
        assert float(row["value"]) == entry.value
        assert row["unit"] == entry.unit
        assert row["upper_only"] == str(entry.upper_only).lower()
        assert float(row["datasheet_value"]) == entry.in_units()[0]
        assert row["datasheet_unit"] == entry.in_units()[3]
        assert row["use"] == calibration.number_verdicts[row["axis"]][entry.symbol].usability.value


def test_latex_is_a_table_for_each_sensor(unit):
    _, calibration = unit
    text = calibration.export(format="latex")
    tables = re.findall(r"\\begin\{tabular\}\{(lr+)\}(.*?)\\end\{tabular\}", text, re.DOTALL)
    assert [len(columns) for columns, _ in tables] == [4, 4]
    for columns, body in tables:
        rows = [line for line in body.splitlines() if line.endswith(r"\\")]
        assert len(rows) > 2
        assert all(row.count("&") == len(columns) - 1 for row in rows)
        assert body.isascii()
        assert body.count("$") % 2 == 0
        assert body.count("{") == body.count("}")
    assert r"gyro\_x" in text


def test_json_has_the_numbers_of_a_filter(unit):
    name, calibration = unit
    content = json.loads(calibration.export(format="json"))
    assert (content["format"], content["version"]) == ("gmwm-numbers", 1)
    for axis, found in content["axes"].items():
        white, walk = of_model(TRUTHS[name][axis])
        assert found["filter"]["N"]["value"] == pytest.approx(white, rel=2e-6)
        assert found["filter"]["K"]["upper_limit"] == (name == "no-walk")
        if name != "no-walk":
            assert found["filter"]["K"]["value"] == pytest.approx(walk, rel=2e-6)
        assert found["filter"]["K"]["unit"] == {"gyro": "rad/s/√s", "accel": "m/s²/√s"}[axis[:-2]]
        assert {p: v["value"] for p, v in found["parameters"].items()} == dict(calibration[axis].parameters)
        assert [e["symbol"] for e in found["datasheet"]] == list(calibration.datasheets[axis])
        assert found["matrices"]["H"]


def test_inflation_scales_the_bias_that_a_comment_offers(units):
    said = re.compile(r"use N (\S+), sigma (\S+), T (\S+) s")
    found = [said.findall(words(units["gauss-markov"].export(format="kalibr", inflation=by))) for by in (1.0, 10.0)]
    assert found[0]
    for plain, inflated in zip(*found, strict=True):
        assert [float(b) / float(a) for a, b in zip(plain, inflated, strict=True)] == pytest.approx(
            [10, 10, 1], rel=0.1
        )
