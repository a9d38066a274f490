"""The examples run, and what they print is true."""

import contextlib
import io
import json
from pathlib import Path

import numpy as np
import pytest

from examples import contaminated, paper

SEED = 2018

pytestmark = pytest.mark.filterwarnings("ignore::gmwm.FitWarning")


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
        assert (truth < low) if truth < paper_s else (high < truth), parameter
    assert "gyro_y: not contaminated" in replayed[1]


def test_models_are_chosen_without_data(replayed):
    rankings, words = replayed[0]["unit"], replayed[1]
    for ranking in rankings.values():
        assert len(ranking) == 31
        assert ranking.recommended in ranking.equivalent
        assert ranking.best.difference == 0
    assert words.count("Left out, as it is not there") == 3
    assert "The truth is recommended on" in words


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
