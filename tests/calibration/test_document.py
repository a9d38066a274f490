"""A calibration goes through its file and comes back to the last bit; what is none says so."""

import json
import math

import numpy as np
import pytest

import gmwm
from gmwm import Calibration
from gmwm.calibration.document import FORMAT, VERSION
from gmwm.errors import ReadError


@pytest.fixture
def file(calibration, tmp_path):
    calibration.save(tmp_path / "calibration.json")
    return tmp_path / "calibration.json"


def test_everything_comes_back(calibration, file):
    back = Calibration.load(file)
    assert back.to_dict() == calibration.to_dict()
    assert back.summary() == calibration.summary()
    assert (back.settings, back.source, back.cautions) == (
        calibration.settings,
        calibration.source,
        calibration.cautions,
    )
    for axis, fit in calibration.items():
        assert back[axis].to_dict() == fit.to_dict()
        assert back.axes[axis].intervals == calibration.axes[axis].intervals
        assert back.datasheets[axis].to_dict() == calibration.datasheets[axis].to_dict()
        assert back.verdicts[axis].to_dict() == calibration.verdicts[axis].to_dict()


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


def test_held_values_come_back():
    found = white("GM + WN(sigma2=fixed(0.5))", 3)
    back = through_json(found)
    assert back.to_dict() == found.to_dict()
    assert back["gyro_x"].model.fixed_names == found["gyro_x"].model.fixed_names == {"WN.sigma2"}
    assert [c.model for c in back.rankings["gyro_x"]] == [c.model for c in found.rankings["gyro_x"]]


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
    parts += [axis["ranking"]["candidates"][0]]
    missing = {key for part in parts for key in part if f"`{key}`" not in words}
    assert missing == set()
    assert f"version {VERSION}" in words


def test_a_file_is_whole_or_not_there(calibration, tmp_path):
    target = tmp_path / "missing" / "calibration.json"
    with pytest.raises(OSError, match=r"calibration\.json"):
        calibration.save(target)
    assert list(tmp_path.iterdir()) == []


def test_a_truncated_file_says_so(file):
    text = file.read_text(encoding="utf-8")
    for part in (0, 1, len(text) // 2, len(text) - 3):
        file.write_text(text[:part], encoding="utf-8")
        with pytest.raises(ReadError, match="is not a calibration: no JSON, or cut short"):
            Calibration.load(file)


@pytest.mark.parametrize("text", ["[1, 2]", "3", '{"command": "fit"}', '{"format": "kalibr", "version": 1}'])
def test_a_foreign_file_says_so(file, text):
    file.write_text(text, encoding="utf-8")
    with pytest.raises(ReadError, match='does not begin with "format": "gmwm-calibration"'):
        Calibration.load(file)


def test_a_binary_file_says_so(file):
    file.write_bytes(b"\x89PNG\r\n\x1a\n\xff\xfe")
    with pytest.raises(ReadError, match="is not a calibration"):
        Calibration.load(file)


def test_a_missing_file_says_where_it_was_looked_for(tmp_path):
    with pytest.raises(ReadError, match=r"none\.json does not exist; looked in "):
        Calibration.load(tmp_path / "none.json")


def test_a_newer_version_says_what_to_do(calibration):
    content = {**calibration.to_dict(), "version": VERSION + 1, "gmwm": "9.0"}
    with pytest.raises(ReadError, match=r"written by gmwm 9\.0; this gmwm reads versions up to 1: install a newer one"):
        Calibration.from_dict(content)


@pytest.mark.parametrize("version", [None, "1", 0, 1.5, True])
def test_a_version_is_a_whole_number(calibration, version):
    with pytest.raises(ReadError, match="version should be a whole number"):
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
def test_what_is_missing_is_an_error_in_words(calibration, path):
    with pytest.raises(ReadError, match="not a"):
        Calibration.from_dict(changed(calibration, path, dict.pop))


@pytest.mark.parametrize("path", PARTS)
def test_what_is_of_the_wrong_kind_is_an_error_in_words(calibration, path):
    def wrong(part, key):
        part[key] = 7

    with pytest.raises(ReadError, match="not a"):
        Calibration.from_dict(changed(calibration, path, wrong))


@pytest.mark.parametrize(
    ("path", "value", "said"),
    [
        (("axes",), [1], "'axes' of the document must be an object, got a list"),
        (("axes",), {}, "'axes' of the document is empty"),
        (("axes", "gyro_x"), None, "'gyro_x' of axes must be an object, got null"),
        (("axes", "gyro_x", "notes"), "none", "'notes' of gyro_x must be a list, got a str"),
        (("axes", "gyro_x", "needed"), {"WN.sigma2": "long"}, "axes.gyro_x.needed.WN.sigma2 must be a number or null"),
        (("axes", "gyro_x", "datasheet", "rate"), None, "axes.gyro_x.datasheet.rate must be a number, got null"),
        (("axes", "gyro_x", "datasheet", "level"), 95, "axes.gyro_x.datasheet.level must be between 0 and 1, got 95"),
        (("axes", "gyro_x", "contamination", "tau"), None, "contamination.tau must be a list of numbers"),
        (("axes", "gyro_x", "fit", "wavelet_variance", "variance"), [1.0], "wavelet_variance.variance has 1,"),
        (("axes", "gyro_x", "fit", "wavelet_variance", "counts"), [1], "there must be as many numbers in each"),
        (("settings", "robust"), 3, "settings.robust must be 'auto', False or True, got 3"),
        (("settings", "confidence"), "high", "settings.confidence must be at least 0.5 and less than 1, got 'high'"),
        (("cautions",), None, "'cautions' of the document must be a list, got null"),
        (("recording", "samples"), 1.5, "recording.samples must be a whole number, got 1.5"),
    ],
)
def test_what_is_wrong_is_named_with_its_file_when_it_is_loaded(calibration, tmp_path, path, value, said):
    file = tmp_path / "wrong.json"
    content = changed(calibration, path, lambda part, key: part.update({key: value}))
    file.write_text(json.dumps(content), encoding="utf-8")
    with pytest.raises(ReadError) as error:
        Calibration.load(file)
    assert str(error.value).startswith(f"{file}: ")
    assert said in str(error.value)


def test_new_keys_alone_do_no_harm(calibration):
    content = calibration.to_dict()
    content["comment"] = "of the bench at the window"
    assert Calibration.from_dict(content).to_dict() == calibration.to_dict()
