"""The examples run, and what they print is true."""

import contextlib
import io
import json
import re
import struct
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import polars as pl
import pytest
from scipy.linalg import block_diag

import gmwm
from examples import array, contaminated, departures, imu_tools, navigation, paper
from examples.monitor import charts

SEED = 2018

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore::gmwm.errors.FitWarning")]


def shared(file: str) -> Path:
    """A file of the data beside the repository, or a reason to skip."""
    path = paper.DATA / file
    if not path.is_file():
        pytest.skip(f"{path} is not there")
    return path


def pictures(folder: Path) -> set[str]:
    """Names of the pictures, none of them empty."""
    files = list(folder.glob("*.png"))
    assert all(file.stat().st_size > 10_000 for file in files)
    return {file.stem for file in files}


@pytest.fixture(scope="module")
def replayed(tmp_path_factory):
    """The paper's example where there are no data: what it finds, what it says, its folder."""
    folder, words = tmp_path_factory.mktemp("paper"), io.StringIO()
    with contextlib.redirect_stdout(words):
        found = paper.main(["--reduced", "--output", str(folder), "--data", str(folder), "--seed", str(SEED)])
    return found, words.getvalue(), folder


def test_array(tmp_path):
    ratios = array.main(["--samples", "100000", "--output", str(tmp_path / "array.png")])
    assert set(ratios) == {"Kalman filter", "weights for 1 min"}
    for found in ratios.values():
        # The scatter of a level with 20 coefficients per scale is 16 %.
        assert np.all(np.abs(found - 1)[:8] < 0.05)
        assert np.all(np.abs(found - 1) < 0.5)
    assert pictures(tmp_path) == {"array"}


@pytest.mark.slow
def test_tools_of_slopes_find_n_and_not_always_k():
    walk, markov = imu_tools.main(hours=1.0).values()
    white = (2e-6 / imu_tools.RATE) ** 0.5
    assert walk["gmwm"] == pytest.approx((white, (1e-12 * imu_tools.RATE) ** 0.5), rel=0.25)
    assert walk["MATLAB's example"][0] == pytest.approx(white, rel=0.02)
    assert walk["… measure_rate: 100"][0] == pytest.approx(2**0.5 * white, rel=0.12)
    assert walk["imu_utils (gyr_n, gyr_w)"][0] == pytest.approx(imu_tools.RATE**0.5 * white, rel=0.1)
    needed = (2 * 0.01 * 2e-9) ** 0.5  # rad/s²/√Hz of the driving noise
    assert markov["gmwm"][1] == pytest.approx(needed, rel=0.4)
    assert markov["allan_variance_ros"][1] < needed / 2


def test_contaminated(tmp_path):
    fits = contaminated.main(str(tmp_path / "contaminated.png"))
    truth = contaminated.TRUTH.parameters["WN.sigma2"]
    assert fits["classical"].parameters["WN.sigma2"] > 1.5 * truth
    assert fits["robust"].parameters["WN.sigma2"] == pytest.approx(truth, rel=0.05)
    assert pictures(tmp_path) == {"contaminated"}


@pytest.mark.parametrize("name", ["classical", "robust, normal errors"])
def test_the_paper_s_estimates_are_found_in_a_recording_simulated_from_them(replayed, name):
    fit = replayed[0]["gyroscope"][name]
    intervals = fit.confidence_intervals(0.999)
    for parameter, truth in paper.CLASSICAL.parameters.items():
        low, high = intervals[parameter]
        assert low <= truth <= high, parameter
    assert fit.goodness_of_fit().pvalue > 0.001


def test_uniform_rounding_errors_move_robust_estimates_as_the_paper_s(replayed):
    fit = replayed[0]["gyroscope"]["robust"]
    intervals = fit.confidence_intervals(0.999)
    for parameter in ("QN.q2", "WN.sigma2"):
        truth, paper_s = paper.CLASSICAL.parameters[parameter], paper.ROBUST.parameters[parameter]
        low, high = intervals[parameter]
        estimate = fit.parameters[parameter]
        assert (truth < estimate) if truth < paper_s else (estimate < truth), parameter
        assert low < truth < high, parameter  # the intervals include this bias
    assert re.search("The test finds no outliers .*gyro_y", replayed[1])


def test_models_are_chosen_without_data(replayed):
    rankings, words = replayed[0]["unit"], replayed[1]
    for ranking in rankings.values():
        assert len(ranking) == 31
        assert ranking.recommended in ranking.equivalent
        assert ranking.best.difference == 0
    assert words.count("Skipped, because the file does not exist") == 3
    assert "The true model is recommended on" in words


def test_figures_of_what_is_simulated(replayed):
    assert pictures(replayed[2]) == {
        "figure_1a_simulated", "figure_1b_simulated", "figure_2", "figure_3a", "figure_3b", "figure_4_simulated",
    }  # fmt: skip


def test_navchip(tmp_path, capsys):
    file = shared("wavelet_variance/navchip.json")
    fits = paper.navchip(file, tmp_path)
    assert set(fits) == set(json.loads(file.read_text())["variance"])
    assert fits["gyro_y"].objective == pytest.approx(7.302028, abs=5e-7)
    assert all(fit.gap <= 1e-3 for fit in fits.values())
    assert "objective 10.81 with the paper's estimates, 7.3020 with ours" in capsys.readouterr().out
    assert pictures(tmp_path) == {"figure_1a", "figure_1b", "figure_3b_navchip"}


def test_mtig(tmp_path):
    rankings = paper.mtig(shared("wavelet_variance/mtig.json"), tmp_path)
    assert len(rankings) == 6
    for ranking in rankings.values():
        assert len(ranking) == 19
        values = [candidate.wic.value for candidate in ranking]
        assert ranking.best.wic.value == min(values)
        # Under one Ω no candidate fits better than the general model, which contains it.
        least = min(candidate.wic.loss for candidate in ranking)
        assert np.isclose(ranking["4*AR1 + WN + RW"].wic.loss, least, rtol=1e-6)
    assert pictures(tmp_path) == {"figure_1a_mtig", "figure_4"}


def test_recorded(tmp_path, capsys):
    calibration = paper.recorded(shared("adis16405_static_1_first_1000s.csv"), tmp_path)
    assert len(calibration) == 6
    assert not calibration.failed
    assert pictures(tmp_path) == {"figure_2_adis", "figure_4_adis"}
    assert "ADIS 16405, recorded for 0.3 h at 100 Hz" in capsys.readouterr().out


# --- navigation ---------------------------------------------------------------------------------------

RUNS = 20


@pytest.fixture(scope="module")
def drives(tmp_path_factory):
    """The navigation example on few drives: its tracks, what it says, its folder."""
    folder, words = tmp_path_factory.mktemp("navigation"), io.StringIO()
    with contextlib.redirect_stdout(words):
        tracks = navigation.main(["--runs", str(RUNS), "--output", str(folder / "navigation.png")])
    return tracks, words.getvalue(), folder


@pytest.mark.parametrize("name", ["true model", "fitted model"])
def test_a_filter_with_the_right_noise_is_as_wrong_as_it_says(drives, name):
    track = drives[0][name]
    low, high = navigation.band(RUNS)
    # Successive seconds go together: 95 % are inside on average, not in every twenty drives.
    assert np.mean((low <= track.nees) & (track.nees <= high)) > 0.8
    for states, _, _ in navigation.SHOWN:
        rms, says = (one[[60, 150, 210, 330, 390]] for one in track.size(states))
        assert np.all(np.abs(rms / says - 1) < 4 / np.sqrt(2 * RUNS))


@pytest.mark.parametrize("name", ["white noise only", "N, B as a constant"])
def test_filters_that_trust_the_sensors_too_much_are_worse_than_they_say(drives, name):
    tracks = drives[0]
    assert np.min(tracks[name].nees[150:]) > 50
    ends = [last for _, last in navigation.OUTAGES]
    for states, _, _ in navigation.SHOWN:
        rms, says = tracks[name].size(states)
        assert np.all(rms[ends] > 4 * says[ends])
        assert np.all(rms[ends] > 1.3 * tracks["fitted model"].size(states)[0][ends])


def test_inflated_numbers_waste_what_the_sensors_know(drives):
    tracks, ends = drives[0], [last for _, last in navigation.OUTAGES]
    assert np.all(tracks["10 N, 10 K"].nees[ends] < navigation.band(RUNS)[0] / 2)
    for states, _, _ in navigation.SHOWN:
        best, inflated = (tracks[name].size(states)[0][ends] for name in ("fitted model", "10 N, 10 K"))
        assert np.all(inflated > 2 * best)


def test_the_navigation_example_tells_and_draws(drives):
    tracks, words, folder = drives
    lines = words.splitlines()
    assert [line[:19].rstrip() for line in lines if line[:19].rstrip() in tracks] == list(tracks)
    assert f"{RUNS} drives of {navigation.SECONDS} s" in words
    assert pictures(folder) == {"navigation"}


def test_the_drive_is_what_sensors_without_errors_add_up_to():
    way = navigation.drive()
    x, each = way.state[:, :1].T, round(navigation.RATE) // navigation.STEPS
    for step in range(navigation.SECONDS * navigation.STEPS):
        x = navigation.strapdown(x, way.sensed[None, :, step * each : (step + 1) * each])[0]
    np.testing.assert_allclose(x[0], way.state[:, -1], rtol=1e-9)


def test_the_filter_knows_how_errors_move():
    way = navigation.drive()
    state, sensed = way.state[:, 12345][None], way.sensed[None, :, 12345:12355]
    after, by_heading, by_sensors = navigation.strapdown(state, sensed)
    turned = state.copy()
    turned[:, 4] += 1e-6
    # Within a step the sensors are taken to be steady: to 2 % of the largest.
    slope = (navigation.strapdown(turned, sensed)[0] - after)[0, :4] / 1e-6
    np.testing.assert_allclose(slope[2:], by_heading[0, 2:], rtol=1e-5)
    np.testing.assert_allclose(slope[:2], by_heading[0, :2], atol=0.02 * np.max(np.abs(by_heading[0, :2])))
    for k in range(3):
        pushed = sensed.copy()
        pushed[:, k] += 1e-6
        slope = -(navigation.strapdown(state, pushed)[0] - after)[0] / 1e-6
        for part in (slice(2, 4), slice(4, 5)):
            size = np.max(np.abs(by_sensors[0, part, k]))
            np.testing.assert_allclose(slope[part], by_sensors[0, part, k], atol=0.02 * size + 1e-9)


def test_the_lines_of_the_document_put_a_model_into_a_filter():
    """A heading that is never corrected gets the variance that the running sum of the noise has."""
    text = (Path(__file__).parents[1] / "docs" / "navigation.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    # What comes before makes a fit to some recording; here it is that of a known model.
    _, code = block.split("turn_on = 1e-3  # rad/s\n")
    model, rate, samples = navigation.TRUTH["gyro_z"], navigation.RATE, 500
    fit = SimpleNamespace(model=model, wavelet_variance=SimpleNamespace(rate=rate))
    names = {"fit": fit, "turn_on": 1e-4, "np": np, "block_diag": block_diag}
    exec(compile(code, "navigation.md", "exec"), names)
    P = block_diag(np.zeros((1, 1)), names["P0"])
    for _ in range(samples):
        P = names["F"] @ P @ names["F"].T + names["Q"]
    expected = model.state_space(rate).block_variance([samples])[0] / rate**2 + (1e-4 * samples / rate) ** 2
    assert P[0, 0] == pytest.approx(expected, rel=1e-9)
    assert names["slow"].F[0, 0] == pytest.approx(np.exp(-0.02 / 10), rel=1e-12)
    assert names["corrected"](3.0, np.array([1.0, 1.0]))[0] == 1.0


@pytest.mark.parametrize("overlapping", [True, False])
@pytest.mark.parametrize(
    "covariance",
    [
        np.eye(256) + departures.bias_instability(256, 50, 0.5),
        departures.growing_white_noise(256, 1.0, 3.0),
        departures.ar1_blocks(256, 60, 0.9, 0.2),
    ],
    ids=["bias", "white", "blocks"],
)
def test_departures_have_the_expected_allan_variance(covariance, overlapping):
    rng = np.random.default_rng(SEED)
    root = np.linalg.cholesky(covariance)
    kind = "overlapping" if overlapping else "nonoverlapping"
    rows = []
    for _ in range(200):
        result = gmwm.allan_variance(root @ rng.standard_normal(256), kind=kind)
        rows.append(result.variance)
    expected = departures.expected_allan_variance(covariance, result.clusters, overlapping)
    assert np.all(np.abs(np.mean(rows, axis=0) - expected) < 4 * np.std(rows, axis=0) / np.sqrt(200))


def test_departures_print_a_fit_that_does_not_see_them(capsys):
    departures.main()
    assert capsys.readouterr().out.count("of GM + WN") == 3
    path = departures.draw(departures.bias_instability(100, 30, 1.0), np.random.default_rng(SEED))
    assert np.unique(path.round(5)).size == 4


def test_charts_of_the_monitor_are_in_the_files_that_the_layouts_show(tmp_path):
    truth = {"gyro": "WN(sigma2=4e-7)", "accel": "WN(sigma2=1e-4)"}
    healthy, broken = (gmwm.simulate(truth, rate=100.0, samples=20_000, rng=seed) for seed in (1, 2))
    gmwm.calibrate(healthy, within="WN").save(tmp_path / "calibration.json")
    values = {axis: broken[axis].values.copy() for axis in broken}
    values["gyro_y"][12_000:] *= 1.5
    gmwm.Imu.from_arrays(values, rate=100.0).write(tmp_path / "broken.csv")
    calibration, recording = str(tmp_path / "calibration.json"), str(tmp_path / "broken.csv")
    trace = charts.main([calibration, recording, "--output", str(tmp_path)])
    assert [event.axis for event in trace.events] == ["gyro_y"]

    table = pl.read_csv(tmp_path / "charts.csv")
    layout = ElementTree.parse(tmp_path / "plotjuggler.xml")
    curves = [curve.attrib["name"] for curve in layout.iter("curve")]
    assert sorted(curves) == sorted(set(table.columns) - {"time"})
    assert layout.find("tabbed_widget").attrib == {"name": "Main Window", "parent": "main_window"}
    assert layout.find("Plugins/plugin/default").attrib["time_axis"] == "time"
    assert table.filter(pl.col("time") > 130)["gyro_y/noise_up"].max() > 1 > table["gyro_x/noise_up"].max()

    messages = list(mcap_messages((tmp_path / "charts.mcap").read_bytes()))
    fields = {f"{topic}.{name}" for topic, _, message in messages for name in message}
    panels = json.loads((tmp_path / "foxglove.json").read_text(encoding="utf-8"))["configById"]
    paths = {path["value"] for panel in panels.values() for path in panel.get("paths", ())} - {"1"}
    assert len(paths) == 18
    assert paths <= fields
    assert [message["message"] for topic, _, message in messages if topic == "/events"] == [str(trace.events[0])]
    stamps = [stamp for _, stamp, _ in messages]
    assert stamps == sorted(stamps)


def mcap_messages(data: bytes):
    """Topic, stamp (ns) and content of each message in JSON."""
    assert data[:8] == data[-8:] == b"\x89MCAP0\r\n"
    topics, place = {}, 8
    while place < len(data) - 8:
        kind, length = struct.unpack_from("<BQ", data, place)
        content = data[place + 9 : place + 9 + length]
        if kind == 4:
            (size,) = struct.unpack_from("<I", content, 4)
            topics[struct.unpack_from("<H", content)[0]] = content[8 : 8 + size].decode()
        if kind == 5:
            channel, _, stamp, _ = struct.unpack_from("<HIQQ", content)
            yield topics[channel], stamp, json.loads(content[22:])
        place += 9 + length
