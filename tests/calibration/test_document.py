"""A calibration is saved and loaded without a change to any bit; a file that is not a calibration is an error."""

import json
import math
import operator
from dataclasses import replace

import numpy as np
import pytest

import gmwm
from gmwm import Calibration
from gmwm.base.errors import ReadError
from gmwm.base.remarks import Remark
from gmwm.calibration.document import FORMAT, VERSION
from tests.helpers import raises


@pytest.fixture
def file(calibration, tmp_path):
    calibration.save(tmp_path / "calibration.json")
    return tmp_path / "calibration.json"


@pytest.mark.slow
def test_everything_comes_back(calibration, file):
    back = Calibration.load(file)
    assert back.to_dict() == calibration.to_dict()
    assert back.summary() == calibration.summary()
    for name in ("settings", "source", "recording_remarks", "remarks", "verdict"):
        assert getattr(back, name) == getattr(calibration, name)
    told = replace(calibration, recording_remarks=(Remark.of("no-test"),))
    assert Calibration.from_dict(told.to_dict()).recording_remarks == told.recording_remarks
    for axis, fit in calibration.items():
        assert back[axis].to_dict() == fit.to_dict()
        assert back.axes[axis].intervals == calibration.axes[axis].intervals
        assert back.datasheets[axis].to_dict() == calibration.datasheets[axis].to_dict()
        assert back.verdicts[axis].to_dict() == calibration.verdicts[axis].to_dict()


@pytest.mark.slow
def test_rankings_come_back_with_their_fits(calibration, file):
    back = Calibration.load(file)
    for axis, ranking in calibration.rankings.items():
        other = back.rankings[axis]
        assert other.summary(None) == ranking.summary(None)
        assert other.compare(0, 1).summary() == ranking.compare(0, 1).summary()
        assert np.array_equal(other.wavelet, ranking.wavelet)
        for mine, yours in zip(ranking, other, strict=True):
            assert yours.model.processes == mine.model.processes
            assert yours.fit.to_dict() == mine.fit.to_dict()
            assert yours.boundary == mine.boundary
        # Candidates that come down to one fit still share it.
        assert len({id(c.fit) for c in other}) == len({id(c.fit) for c in ranking})


def through_json(found):
    return Calibration.from_dict(json.loads(json.dumps(found.to_dict(), allow_nan=False)))


def white(within, seed):
    x = gmwm.Model.parse("WN(sigma2=1.0)").simulate(20_000, 100.0, rng=seed)
    return gmwm.calibrate(gmwm.Signal(x, 100.0, "rad/s", "gyro_x"), within)


@pytest.mark.slow
def test_held_values_come_back():
    found = white("GM + WN(sigma2=fixed(0.5))", 3)
    back = through_json(found)
    assert back.to_dict() == found.to_dict()
    assert back["gyro_x"].model.fixed_names == found["gyro_x"].model.fixed_names == {"WN.sigma2"}
    assert [c.model for c in back.rankings["gyro_x"]] == [c.model for c in found.rankings["gyro_x"]]


@pytest.mark.slow
def test_infinite_limits_come_back():
    found = white("GM", 1)
    assert any(math.isinf(high) for _, high in found.axes["gyro_x"].intervals.values())
    back = through_json(found)
    assert back.to_dict() == found.to_dict()
    assert back.axes["gyro_x"].intervals == found.axes["gyro_x"].intervals


def test_the_head_of_the_document(file):
    content = json.loads(file.read_text(encoding="utf-8"))
    assert list(content)[:3] == ["format", "version", "gmwm"]
    assert (content["format"], content["version"], content["gmwm"]) == (FORMAT, VERSION, gmwm.__version__)
    assert file.read_bytes().endswith(b"}\n")


def test_the_description_names_every_key(calibration, pytestconfig):
    words = (pytestconfig.rootpath / "docs" / "calibration-format.md").read_text(encoding="utf-8")
    content = calibration.to_dict()
    axis = next(iter(content["axes"].values()))
    parts = [content, content["settings"], axis, axis["fit"], axis["fit"]["wavelet_variance"], axis["goodness_of_fit"]]
    parts += [axis["datasheet"], axis["datasheet"]["entries"][0], axis["contamination"], axis["ranking"]]
    parts += [axis["ranking"]["candidates"][0], axis["spectrum"], axis["misfit"]]
    missing = {key for part in parts for key in part if f"`{key}`" not in words}
    assert missing == set()
    assert f"version {VERSION}" in words


def test_a_file_is_whole_or_not_there(calibration, tmp_path):
    target = tmp_path / "missing" / "calibration.json"
    with pytest.raises(OSError, match=r"calibration\.json"):
        calibration.save(target)
    assert list(tmp_path.iterdir()) == []


def test_a_truncated_file_is_an_error(file):
    text = file.read_text(encoding="utf-8")
    for part in (0, 1, len(text) // 2, len(text) - 3):
        file.write_text(text[:part], encoding="utf-8")
        with raises(ReadError, file, "JSON"):
            Calibration.load(file)


@pytest.mark.parametrize("text", ["[1, 2]", "3", '{"command": "fit"}', '{"format": "kalibr", "version": 1}'])
def test_a_file_of_another_format_is_an_error(file, text):
    file.write_text(text, encoding="utf-8")
    with raises(ReadError, file, FORMAT):
        Calibration.load(file)


def test_a_binary_file_is_an_error(file):
    file.write_bytes(b"\x89PNG\r\n\x1a\n\xff\xfe")
    with raises(ReadError, file, "JSON"):
        Calibration.load(file)


def test_a_missing_file_is_named_with_its_folder(tmp_path):
    with raises(ReadError, "none.json", tmp_path):
        Calibration.load(tmp_path / "none.json")


@pytest.mark.parametrize(("version", "advice"), [(VERSION + 1, "newer gmwm"), (VERSION - 1, "Calibrate")])
def test_another_version_says_what_to_do(calibration, version, advice):
    content = {**calibration.to_dict(), "version": version, "gmwm": "9.0"}
    with raises(ReadError, f"version {version} ", "gmwm 9.0", f"reads version {VERSION}", advises=[advice]):
        Calibration.from_dict(content)


@pytest.mark.parametrize("version", [None, "1", 0, 1.5, True])
def test_a_version_is_a_whole_number(calibration, version):
    with raises(ReadError, "version", repr(version)):
        Calibration.from_dict({**calibration.to_dict(), "version": version})


def at(content, path):
    for key in path:
        content = content[key]
    return content


PARTS = [
    ("axes",),
    ("failed",),
    ("settings",),
    ("axes", "gyro_x", "fit"),
    ("axes", "gyro_x", "fit", "weighting_matrix"),
    ("axes", "gyro_x", "datasheet"),
    ("axes", "gyro_x", "ranking", "fits"),
    ("axes", "gyro_x", "ranking", "candidates"),
]
NUMBERS = [
    ("settings", "within"),
    ("axes", "gyro_x", "contamination", "pvalue"),
    ("axes", "gyro_x", "goodness_of_fit", "df"),
]


def changed(calibration, path, change):
    content = json.loads(json.dumps(calibration.to_dict()))
    change(at(content, path[:-1]), path[-1])
    return content


@pytest.mark.parametrize("path", PARTS + NUMBERS)
def test_a_missing_part_is_an_error_that_names_it(calibration, path):
    with raises(ReadError, path[-1]):
        Calibration.from_dict(changed(calibration, path, dict.pop))


@pytest.mark.parametrize("path", PARTS)
def test_a_part_of_the_wrong_kind_is_an_error_that_names_it(calibration, path):
    def wrong(part, key):
        part[key] = 7

    with raises(ReadError, *(path[1:3] or path)):
        Calibration.from_dict(changed(calibration, path, wrong))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("path", "value", "facts"),
    [
        (("axes",), [1], ("'axes'", "an object", "a list")),
        (("axes",), {}, ("'axes'", "empty")),
        (("axes", "gyro_x"), None, ("'gyro_x'", "an object", "null")),
        (("axes", "gyro_x", "fit", "remarks"), "none", ("gyro_x.fit",)),
        (("axes", "gyro_x", "needed"), {"WN.sigma2": "long"}, ("axes.gyro_x.needed.WN.sigma2", "a number or null")),
        (("axes", "gyro_x", "datasheet", "rate"), None, ("axes.gyro_x.datasheet.rate", "a number", "null")),
        (("axes", "gyro_x", "datasheet", "level"), 95, ("axes.gyro_x.datasheet.level", "between 0 and 1", "95")),
        (("axes", "gyro_x", "contamination", "tau"), None, ("contamination.tau", "a list of numbers")),
        (("axes", "gyro_x", "contamination", "levels"), [[1], [2]], ("contamination.levels", "a list of numbers")),
        (("axes", "gyro_x", "fit", "wavelet_variance", "variance"), [1.0], ("gyro_x.fit", "variance", "(1,)")),
        (("axes", "gyro_x", "fit", "wavelet_variance", "counts"), [1], ("gyro_x.fit", "counts", "(1,)")),
        (("settings", "robust"), 3, ("settings.robust", "'auto'", "3")),
        (("settings", "confidence"), "high", ("settings.confidence", "0.5", "'high'")),
        (("recording_remarks",), None, ("'recording_remarks'", "a list", "null")),
        (("recording", "samples"), 1.5, ("recording.samples", "a whole number", "1.5")),
        (("recording", "samples"), 0, ("recording.samples", "above zero")),
        (("axes", "gyro_x", "fit", "wavelet_variance", "rate"), 1e-306, ("wavelet_variance.rate", "at least 1e-150")),
        (("recording", "missing"), -1.0, ("recording.missing", "negative")),
        (("recording", "duration"), "NaN", ("recording.duration", "numbers only")),
        (("recording", "segments"), 10**30, ("recording.segments", "exceed")),
        (("axes", "gyro_x", "goodness_of_fit", "df"), -1, ("goodness_of_fit.df", "negative")),
        (("axes", "gyro_x", "goodness_of_fit", "pvalue"), 1.5, ("goodness_of_fit.pvalue", "from 0 to 1")),
        (("axes", "gyro_x", "contamination", "comparisons"), 0, ("contamination.comparisons", "above zero")),
        (("axes", "gyro_x", "contamination", "spikes"), -3, ("contamination.spikes", "negative")),
        (("axes", "gyro_x", "rest", "error"), -1e-4, ("rest.error", "negative")),
        (("axes", "gyro_x", "model_error"), -0.1, ("model_error", "negative")),
        (("axes", "gyro_x", "confidence_intervals", "WN.sigma2"), [2.0, 1.0], ("confidence_intervals", "2.0")),
        (("axes", "gyro_x", "ranking", "wavelet_covariance", 0, 0), -1.0, ("wavelet_covariance", "negative")),
        (("axes", "gyro_x", "ranking", "weighting_matrix", 0, 1), 1e60, ("weighting_matrix", "symmetric")),
        (("axes", "gyro_x", "spectrum", "degrees_of_freedom", 0), 0.0, ("spectrum.degrees_of_freedom", "above zero")),
        (("axes", "gyro_x", "spectrum", "blocks"), 0, ("spectrum.blocks", "above zero")),
    ],
)
def test_a_wrong_value_is_named_with_its_file(calibration, tmp_path, path, value, facts):
    file = tmp_path / "wrong.json"
    content = changed(calibration, path, lambda part, key: operator.setitem(part, key, value))
    file.write_text(json.dumps(content), encoding="utf-8")
    with raises(ReadError, f"{file}: ", *facts):
        Calibration.load(file)


def test_unknown_keys_are_ignored(calibration):
    content = calibration.to_dict()
    content["comment"] = "of the bench at the window"
    assert Calibration.from_dict(content).to_dict() == calibration.to_dict()


@pytest.mark.slow
def test_a_calibration_of_a_recording_with_knocks_comes_back():
    clean = gmwm.simulate({"gyro_x": "WN(sigma2=4e-7)"}, rate=100.0, samples=30_000, rng=4)["gyro_x"].values
    knocked = clean.copy()
    knocked[12_000:12_040] += 0.05 * np.cos(2.0 * np.arange(40))
    found = gmwm.calibrate(gmwm.Imu.from_arrays({"gyro_x": knocked}, 100.0), models={"gyro_x": "WN"})
    verdict = found.axes["gyro_x"].verdict
    assert verdict is not None
    assert len(verdict.replaced.knocks) == 1
    again = gmwm.Calibration.from_dict(json.loads(json.dumps(found.to_dict())))
    assert again.to_dict() == found.to_dict()
