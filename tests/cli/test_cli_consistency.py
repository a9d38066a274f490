"""gmwm consistency: one line for each axis, JSON, picture and errors."""

import numpy as np
import pytest


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """Two gyroscopes, written as a CSV file."""
    rng, folder = np.random.default_rng(1), tmp_path_factory.mktemp("consistency")
    columns = [1e-3 * rng.normal(size=40_000) + np.cumsum(1e-5 * rng.normal(size=40_000)) for _ in "xy"]
    table = np.column_stack([np.arange(40_000) / 20, *columns])
    heads = "time,gyro_x [rad/s],gyro_y [rad/s]"
    np.savetxt(folder / "night.csv", table, delimiter=",", header=heads, comments="", fmt="%.9g")
    return folder / "night.csv"


SHEET = "gyro: N=0.76872deg/√h, K=553.4deg/h/√h"


@pytest.mark.slow
def test_a_line_for_each_axis(gmwm, recording, tmp_path):
    outcome = gmwm("consistency", SHEET, recording, "--plot", tmp_path / "c.png")
    assert outcome.code == 0, outcome.err
    lines = [line.split()[:2] for line in outcome.out.splitlines()]
    assert ["gyro_x", "✓"] in lines
    assert ["gyro_y", "✓"] in lines
    assert (tmp_path / "c.png").is_file()


def test_json(gmwm, recording):
    content = gmwm("consistency", "gyro: N=0.4deg/√h, K=553deg/h/√h", recording, "--horizons", "2s", "--json").json
    axis = content["axes"]["gyro_x"]
    assert content["filter"] == "N, K"
    assert axis["verdict"] == "overconfident"
    assert [error["horizon"] for error in axis["errors"]] == [2.0]
    assert axis["errors"][0]["ratio"] < 0.7 < axis["nis"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "said"),
    [(["--horizons", "soon"], "--horizons"), (["--filter", "markov"], "filter"), (["--axis", "accel_x"], "accel_x")],
)
def test_errors(gmwm, recording, arguments, said):
    gmwm("consistency", SHEET, recording, *arguments).require_refusal(said)
