"""`gmwm plan`: from a model in words, and from what a pilot recording gave."""

import json

import pytest

import gmwm as library
from gmwm import Model
from gmwm.base.time_base import parse_length
from gmwm.cli.plan import _as_seen, fits_in

MODEL = "GM(beta=0.1, sigma2=1e-8) + WN(sigma2=4e-6)"


@pytest.fixture(scope="module")
def fits(gmwm, recording, tmp_path_factory):
    """The fits.json of a pilot recording of two axes."""
    folder = tmp_path_factory.mktemp("pilot")
    options = ("--model", "WN + RW", "--axis", "gyro_x,gyro_y", "--no-certify", "--output", folder)
    assert gmwm("fit", recording, *options).code == 0
    return folder / "fits.json"


@pytest.mark.slow
def test_it_prints_the_summary_and_draws(gmwm, tmp_path):
    target = tmp_path / "plan.png"
    outcome = gmwm("plan", MODEL, "--rate", 100, "--duration", "2h", "--accuracy", 0.2, "--plot", target)
    assert outcome.code == 0
    assert library.plan(MODEL, duration=7200.0, rate=100.0).summary(0.2) in outcome.out
    assert "for 20 %" in outcome.out
    assert str(target) in outcome.out
    assert target.read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
def test_a_folder_stands_for_what_is_in_it(gmwm, fits, tmp_path):
    arguments = ("--axis", "gyro_y", "--duration", "1d", "--json")
    of_file, of_folder = (gmwm("plan", "--from-fits", path, *arguments).json for path in (fits, fits.parent))
    assert of_folder["needed"] == of_file["needed"]
    outcome = gmwm("plan", "--from-fits", tmp_path, *arguments)
    assert outcome.err.startswith(f"error: {tmp_path} ")
    assert "fits.json" in outcome.err
    for name in ("fits.json", "calibration.json"):
        (tmp_path / name).write_bytes(fits.read_bytes())
    both = gmwm("plan", "--from-fits", tmp_path, *arguments)
    assert both.err.startswith(f"error: {tmp_path} ")
    assert both.err != outcome.err


@pytest.mark.slow
def test_json_is_the_library_s(gmwm):
    content = gmwm("plan", MODEL, "--rate", 100, "--duration", "1min", "--weighting", "optimal", "--json").json
    plan = library.plan(MODEL, duration=60.0, rate=100.0, weighting="optimal")
    assert content["command"] == "plan"
    assert content["needed"] == plan.needed(0.1)
    assert content["accuracy"] == 0.1
    assert {name: content[name] for name in plan.to_dict()} == plan.to_dict()
    assert content["remarks"] == [remark.to_dict() for remark in plan.remarks]
    (uncertain,) = (one for one in content["remarks"] if one["code"] == "poorly-known")
    assert "GM.beta" in uncertain["facts"]["parameters"]
    assert uncertain["facts"]["duration"] == {"value": 60.0, "unit": "s"}


def test_what_is_infinite_is_null(gmwm):
    content = gmwm(
        "plan", "GM(beta=1e6, sigma2=1.0) + WN(sigma2=1.0)", "--rate", 100, "--duration", "60", "--json"
    ).json
    assert content["needed"]["WN.sigma2"] is None
    assert content["planned"]["WN.sigma2"] is None


@pytest.mark.slow
def test_from_a_pilot_recording(gmwm, fits):
    found = json.loads(fits.read_text(encoding="utf-8"))["axes"]["gyro_y"]
    content = gmwm("plan", "--from-fits", fits, "--axis", "gyro_y", "--duration", "1d", "--json").json
    assert content["axis"] == "gyro_y"
    assert content["parameters"] == found["parameters"]
    assert content["rate"] == found["wavelet_variance"]["rate"]
    assert content["units"]["WN.sigma2"] == "(rad/s)²"


def of_model(document, text, acts_as):
    """Give the document of a fit another model."""
    model = Model.parse(text)
    document |= {
        "model": text,
        "parameters": dict(model.parameters),
        "acts_as": acts_as,
        "decomposition": dict.fromkeys(model.terms, document["implied"]),
    }


@pytest.mark.slow
def test_terms_that_the_pilot_does_not_show_are_remarked(gmwm, fits, tmp_path):
    content = json.loads(fits.read_text(encoding="utf-8"))
    one = content["axes"]["gyro_x"]
    of_model(one, "GM(beta=1e4, sigma2=1e-9) + WN(sigma2=4e-7) + QN(q2=0.0) + RW(gamma2=1e-11)", {"GM": "WN"})
    content["axes"] = {"gyro_x": one}
    path = tmp_path / "fits.json"
    path.write_text(json.dumps(content), encoding="utf-8")
    outcome = gmwm("plan", "--from-fits", path, "--duration", "1h", "--json")
    assert outcome.code == 0
    remarks = {one["code"]: one["facts"] for one in outcome.json["remarks"]}
    assert remarks["term-zero"] == {"case": "pilot", "terms": ["QN"]}
    assert remarks["correlation-time-unknown"]["term"] == "GM"
    assert remarks["correlation-time-unknown"]["process"].startswith("WN(sigma2=")
    # A correlation time of 0.1 ms is white at 100 Hz: its variance is that of the samples.
    assert outcome.json["parameters"] == pytest.approx({"WN.sigma2": 4.01e-7, "RW.gamma2": 1e-11}, rel=1e-6)
    one["acts_as"] = {"GM": "UNKNOWN"}
    path.write_text(json.dumps(content), encoding="utf-8")
    outcome = gmwm("plan", "--from-fits", path, "--duration", "1h", "--json")
    (remark,) = (one for one in outcome.json["remarks"] if one["code"] == "correlation-time-unknown")
    assert remark["facts"] == {"case": "undetermined", "term": "GM", "process": "UNKNOWN"}
    assert f"warning: {remark['text']} [correlation-time-unknown]" in outcome.err.splitlines()


@pytest.mark.slow
def test_a_term_that_acts_as_one_that_is_not_in_the_model_is_that_one(gmwm, fits, tmp_path):
    content = json.loads(fits.read_text(encoding="utf-8"))
    one = content["axes"]["gyro_x"]
    of_model(one, "GM(beta=1e-9, sigma2=0.5) + WN(sigma2=4e-7)", {"GM": "RW"})
    path = tmp_path / "fits.json"
    path.write_text(json.dumps({**content, "axes": {"gyro_x": one}}), encoding="utf-8")
    found = gmwm("plan", "--from-fits", path, "--duration", "1h", "--json").json
    assert found["parameters"] == pytest.approx({"WN.sigma2": 4e-7, "RW.gamma2": 2 * 1e-9 * 0.5 / 100}, rel=1e-4)


@pytest.mark.parametrize(
    ("text", "seconds"),
    [("1h30m", 5400), ("2hours", 7200), ("2 h", 7200), ("1 day 2 hrs", 93600), ("1e3s", 1000), ("250ms", 0.25)],
)
def test_lengths_in_words(text, seconds):
    assert parse_length(text) == seconds


@pytest.mark.slow
def test_an_accuracy_in_per_cent(gmwm):
    plain, per_cent = (
        gmwm("plan", "WN(sigma2=1.0)", "--rate", 100, "--duration", "1min", "--accuracy", share, "--json").json
        for share in ("0.2", "20%")
    )
    assert plain == per_cent


@pytest.mark.parametrize(
    ("arguments", "facts"),
    [
        (
            (MODEL, "--rate", 100, "--duration", "2x"),
            ["--duration must be ", "1h30m", "; got '2x'"],
        ),
        ((MODEL, "--rate", 100, "--duration", "1h30"), ["--duration must be ", "; got '1h30'"]),
        (
            (MODEL, "--rate", 100, "--duration", "2h", "--accuracy", "ten"),
            ["--accuracy must be ", "10%", "; got 'ten'"],
        ),
        ((MODEL, "--rate", 100, "--duration", "0"), ["duration", "0"]),
        ((MODEL, "--duration", "2h"), ["--rate"]),
        (("--duration", "2h"), ["MODEL", "--from-fits"]),
        ((MODEL, "--from-fits", "FITS", "--duration", "2h"), ["MODEL", "--from-fits"]),
        (("--from-fits", "FITS", "--duration", "2h"), ["--axis must be ", "gyro_x, gyro_y", "fits.json"]),
        (("--from-fits", "FITS", "--axis", "gyro_z", "--duration", "2h"), ["--axis must be ", "; got 'gyro_z'"]),
        (
            ("--from-fits", "FITS", "--axis", "gyro_x", "--rate", 50, "--duration", "2h"),
            ["--rate 50", "100 Hz", "fits.json"],
        ),
        ((MODEL, "--axis", "gyro_x", "--rate", 100, "--duration", "2h"), ["--axis", "--from-fits"]),
        ((MODEL, "--rate", 100, "--duration", "2h", "--accuracy", 0.7), ["accuracy", "0.7"]),
        (("FITS", "--rate", 100, "--duration", "2h"), ["MODEL", "--from-fits"]),
        (("GM + WN", "--rate", 100, "--duration", "2h"), ["GM.beta, GM.sigma2, WN.sigma2"]),
    ],
)
def test_what_is_refused(gmwm, fits, arguments, facts):
    gmwm("plan", *(fits if word == "FITS" else word for word in arguments)).require_refusal(*facts)


@pytest.mark.parametrize("name", ["filter", "transform", "unit", "axis", "recordings", "excess"])
def test_a_value_that_has_a_default_can_be_left_out(fits, tmp_path, name):
    content = json.loads(fits.read_text())
    for one in content["axes"].values():
        one["wavelet_variance"].pop(name, None)
    (tmp_path / "fits.json").write_text(json.dumps(content))
    _, found = fits_in(tmp_path)
    for one in found.values():
        assert name in one["wavelet_variance"]
        _as_seen(one)


def test_files_that_hold_no_fits(gmwm, tmp_path):
    for name, text in {
        "no.json": "no",
        "list.json": "[]",
        "wv.json": '{"command": "wv", "axes": {"gyro_x": {}}}',
    }.items():
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        gmwm("plan", "--from-fits", path, "--duration", "1h").require_refusal(f"error: {path} ")
    assert gmwm("plan", "--from-fits", tmp_path / "none.json", "--duration", "1h").code == 2


@pytest.mark.slow
def test_the_plan_has_the_gaps_of_the_pilot_recording(gmwm, fits, tmp_path):
    content = json.loads(fits.read_text())
    curve = content["axes"]["gyro_x"]["wavelet_variance"]
    curve["filled"] = curve["samples"] // 5
    (tmp_path / "fits.json").write_text(json.dumps(content))
    given = ("--axis", "gyro_x", "--duration", "1h", "--json")
    lossy, whole = (gmwm("plan", "--from-fits", path, *given).json for path in (tmp_path, fits))
    assert lossy["losses"]["filled"] == pytest.approx(0.2)
    for name, error in whole["planned"].items():
        assert lossy["planned"][name] == pytest.approx(1.5**0.5 * error, rel=1e-6)
    assert "20 % of the samples are filled" in gmwm("plan", "--from-fits", tmp_path, *given[:-1]).out
