"""gmwm budget: text, JSON, picture, comparison and errors."""

import json

import pytest

import gmwm as library


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """fits.json of two axes, and another one with twice the noise."""
    folder = tmp_path_factory.mktemp("budget")
    for k, (name, size) in enumerate((("one", 1e-6), ("two", 4e-6))):
        imu = library.simulate(
            {"gyro_x": f"WN(sigma2={size})", "accel_y": f"WN(sigma2={100 * size})"}, rate=100.0, samples=20_000, rng=k
        )
        (folder / name).mkdir()
        fits = {axis: library.fit("WN", imu[axis]).to_dict() for axis in imu}
        (folder / name / "fits.json").write_text(json.dumps({"command": "fit", "file": "x.csv", "axes": fits}))
    return folder


@pytest.mark.slow
def test_text_and_picture(gmwm, results, tmp_path):
    outcome = gmwm("budget", results / "one", "--duration", "60s", "--plot", tmp_path / "b.png")
    assert outcome.code == 0
    assert outcome.out.startswith("After 60 s of navigation without corrections: tilt 0.0")
    assert "gyro_x WN" in outcome.out
    assert (tmp_path / "b.png").is_file()


def test_json_has_the_numbers(gmwm, results):
    content = gmwm("budget", results / "one", "--duration", "1min", "--rest", "10s", "--json").json
    fits = json.loads((results / "one" / "fits.json").read_text())["axes"]
    found = library.navigation.budget({a: library.Fit.from_dict(f) for a, f in fits.items()}, 60.0, rest=10.0)
    assert content["growth"]["tilt_x"]["error"] == found["tilt_x"].error.tolist()
    assert content["rest"] == 10.0
    assert {remark["code"] for remark in content["remarks"]} == {"budget-axes-missing"}


def test_comparison(gmwm, results):
    outcome = gmwm("budget", results / "one", "--duration", "60", "--against", results / "two")
    line = next(
        line
        for line in outcome.out.splitlines()
        if line.split()[:3] == ["tilt", "about", "x"] and line.endswith("2.00")
    )
    assert line
    assert "ratio" in outcome.out


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["{one}"], "--duration"),
        (["nowhere.json", "--duration", "60s"], "nowhere.json"),
        (["{one}", "--duration", "soon"], "--duration"),
        (["{one}", "--duration", "60s", "--rest", "-1"], "--rest"),
        (["{one}", "--duration", "60s", "--latitude", "95"], "--latitude"),
        (["{one}", "--duration", "60s", "--against", "{one}"], "--against"),
    ],
)
def test_errors_are_one_line(gmwm, results, arguments, said):
    gmwm("budget", *[part.format(one=results / "one") for part in arguments]).require_refusal(said)
