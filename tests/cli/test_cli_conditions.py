"""`gmwm fit --conditions`."""

import numpy as np
import pytest

import gmwm as package
from gmwm.cli.conditions import read_table

TABLE = "start,stop,rate\n0,40,0\n45,95,50\n100,145,100\n150,190,0\n"


@pytest.fixture(scope="module")
def turned(tmp_path_factory):
    """A recording of 200 s on a turntable, and the table of its rates."""
    rng, folder = np.random.default_rng(1), tmp_path_factory.mktemp("turned")
    parts = [
        np.radians(rate) + 1e-3 * np.sqrt(1 + (rate / 50) ** 2) * rng.normal(size=seconds * 100)
        for rate, seconds in ((0, 42), (50, 56), (100, 50), (0, 52))
    ]
    package.Imu.from_arrays({"gyro_z": np.concatenate(parts)}, rate=100).write(folder / "turn.csv")
    (folder / "rates.csv").write_text(TABLE)
    return folder


def run(gmwm, folder, *more, table="rates.csv"):
    file = folder / "turn.csv"
    return gmwm("fit", file, "--model", "WN", "--conditions", folder / table, "--varies", "WN: 1 + rate**2", *more)


@pytest.mark.slow
def test_the_coefficients_are_printed_and_written(gmwm, turned, tmp_path):
    shown = run(gmwm, turned, "--output", tmp_path)
    assert shown.code == 0
    assert "WN.sigma2 (rate^2)" in shown.out
    assert {"fits.json", "fit_gyro_z.png", "numbers_gyro_z.csv"} == {path.name for path in tmp_path.iterdir()}
    found = run(gmwm, turned, "--json").json["axes"]["gyro_z"]
    assert found["estimates"]["WN.sigma2 (rate^2)"]["value"] == pytest.approx(1e-6 / 2500, rel=0.1)
    assert [one["condition"] for one in found["conditions"]] == [0.0, 50.0, 100.0]
    # Two parts at rest with a gap between them.
    assert len(found["conditions"][0]["wavelet_variance"]["segments"]) == 2


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ("begin,stop,rate\n0,40,0\n", "start,stop,rate"),
        ("start,stop,rate\n0,forty,0\n", "row 2"),
        ("start,stop,rate\n40,0,0\n", "before the stop"),
        ("start,stop,rate\n0,40,0\n30,80,50\n", "overlap"),
        ("", "start,stop,rate"),
    ],
)
def test_a_wrong_table_is_one_error(gmwm, turned, table, words):
    (turned / "wrong.csv").write_text(table)
    failed = run(gmwm, turned, table="wrong.csv")
    assert failed.code != 0
    assert words in failed.err
    assert "Traceback" not in failed.err


@pytest.mark.parametrize("option", [("--likelihood",), ("--against", "time"), ("--filter", "d4"), ("--chunked", "yes")])
def test_options_that_do_not_apply_are_errors(gmwm, turned, option):
    failed = run(gmwm, turned, *option)
    assert failed.code != 0
    assert option[0].lstrip("-") in failed.err


@pytest.mark.slow
def test_varies_needs_a_table_of_the_same_condition(gmwm, turned):
    assert "--conditions" in gmwm("fit", turned / "turn.csv", "--model", "WN", "--varies", "WN: 1").err
    table = turned / "rates.csv"
    for varies in ("WN: 1 + speed", "WN", "WN:"):
        failed = gmwm("fit", turned / "turn.csv", "--model", "WN", "--conditions", table, "--varies", varies)
        assert failed.code != 0
        assert "varies" in failed.err


def test_parts_at_one_condition_are_joined_in_order(turned):
    table = read_table(turned / "rates.csv")
    assert table.condition == "rate"
    assert table.parts == {0.0: [(0.0, 40.0), (150.0, 190.0)], 50.0: [(45.0, 95.0)], 100.0: [(100.0, 145.0)]}


@pytest.mark.slow
def test_a_condition_that_moves(gmwm, tmp_path):
    rng, t = np.random.default_rng(2), np.arange(30_000) / 100
    rate = 100 * np.abs((t / 100) % 2 - 1)
    noise = 1e-3 * np.sqrt(1 + (rate / 50) ** 2) * rng.normal(size=t.size)
    package.Imu.from_arrays({"gyro_z": noise}, rate=100).write(tmp_path / "ramp.csv")
    (tmp_path / "rates.csv").write_text("time,rate\n0,100\n100,0\n200,100\n300,0\n")
    arguments = ("--model", "WN", "--conditions", tmp_path / "rates.csv", "--varies", "WN: 1 + rate**2")
    outcome = gmwm("fit", tmp_path / "ramp.csv", *arguments, "--output", tmp_path / "out")
    assert outcome.code == 0, outcome.err
    assert "the whole recording, because rate changes too fast" in outcome.out
    table = (tmp_path / "out" / "numbers_gyro_z.csv").read_text().splitlines()
    assert table[0] == "rate,N,K"
    assert len(table) == 9
    (tmp_path / "rates.csv").write_text("time,rate\n0,100\n100,0\n")
    assert "known from 0 to 100 s" in gmwm("fit", tmp_path / "ramp.csv", *arguments).err
    (tmp_path / "rates.csv").write_text("time,rate\n0,100\n0,0\n")
    assert "ascending" in gmwm("fit", tmp_path / "ramp.csv", *arguments).err
