"""`--against` with seasons and steps: daily series of ten years with flicker noise and missing days, from NumPy."""

import numpy as np
import pytest

import gmwm as library

DAYS = 3650
YEAR = 365.25
TRUTH = {"time": 3.65, "season:1y cos": -1.0, "season:1y sin": 3.0, "step:2000d": 8.0}
OPTIONS = ("--units", "accel=m/s²", "--model", "WN + FN")


def _series(seed):
    """Return daily heights and the mask of the present days: 18 % are missing, and the step is in a gap of 22 days."""
    rng = np.random.default_rng(seed)
    t = np.arange(DAYS)
    lags = np.arange(1, DAYS)
    response = np.append(1.0, np.cumprod((lags - 0.5) / lags))  # flicker noise: (1 - B)^(-1/2)
    shocks = rng.standard_normal(DAYS)
    noise = np.fft.irfft(np.fft.rfft(response, 2 * DAYS) * np.fft.rfft(shocks, 2 * DAYS))[:DAYS]
    turn = 2 * np.pi * t / YEAR
    effect = 3.65 * t / YEAR - np.cos(turn) + 3 * np.sin(turn) + 8.0 * (t >= 2000)
    chain = [True]
    for share in rng.random(DAYS - 1).tolist():  # a Markov chain with gaps of four days on average
        chain.append(share > 0.18 / 0.82 / 4 if chain[-1] else share < 0.25)
    present = np.array(chain)
    present[1990:2012] = False
    present[-1] = True
    return effect + noise + 2.0 * rng.standard_normal(DAYS), present


@pytest.fixture(scope="module")
def series(tmp_path_factory):
    path = tmp_path_factory.mktemp("series") / "series.csv"
    values, present = _series(1)
    stamps = np.datetime64("2014-01-01T00:00:00") + np.arange(DAYS) * np.timedelta64(1, "D")
    rows = [f"{stamps[k]},{values[k]:.4f}" for k in np.flatnonzero(present)]
    path.write_text("\n".join(["time,accel_x", *rows]) + "\n")
    return path


@pytest.mark.slow
def test_coefficients_are_covered():
    inside = dict.fromkeys(TRUTH, 0)
    for seed in range(100, 120):
        values, present = _series(seed)
        signal = library.Signal.from_missing(np.where(present, values, np.nan), rate=1 / 86400)
        regression = library.fit("WN + FN", signal, against="time + season:1y + step:2000d").regression
        for name, value in TRUTH.items():
            low, high = regression[name].interval()
            inside[name] += low < value < high
    assert min(inside.values()) >= 16  # binomial (20, 0.95): below with a probability of 0.3 %


@pytest.mark.slow
def test_the_shell_prints_a_rate_per_year_and_a_step_in_a_gap(gmwm, series):
    parts = ("--against", "time", "--against", "season:1y", "--against", "step:2019-06-24")
    regression = gmwm("fit", series, *OPTIONS, *parts, "--json").json["axes"]["accel_x"]
    regression = regression["wavelet_variance"]["regression"]
    assert regression["against"] == "time:yr + season:1y + step:2019-06-24"
    assert regression["coefficients"]["time"]["unit"] == "(m/s²)/yr"
    for value, coefficient in zip(TRUTH.values(), regression["coefficients"].values(), strict=True):
        low, high = coefficient["interval"]
        assert low < value < high
    joined = gmwm("fit", series, *OPTIONS, "--against", "time + season:1y + step:2000d")
    assert "(m/s²)/yr" in joined.out
    assert "step:2000d" in joined.out


@pytest.mark.slow
def test_a_table_of_dates_needs_the_name_and_the_unit_of_its_height(gmwm, tmp_path):
    values, present = _series(3)
    days = np.datetime64("2014-01-01") + np.flatnonzero(present)
    path = tmp_path / "heights.csv"
    path.write_text(
        "when,h0\n" + "".join(f"{day},{value:.2f}\n" for day, value in zip(days, values[present], strict=True))
    )
    assert "--columns time,up" in gmwm("fit", path, "-m", "WN").err
    reading = ("--columns", "time,up")
    assert "--units position=mm" in gmwm("fit", path, *reading, "-m", "WN").err
    reading += ("--units", "position=mm")
    fit = gmwm("fit", path, *reading, "-m", "WN + FN", "--against", "time + season:1y + step:2019-06-24", "--json")
    coefficients = fit.json["axes"]["up"]["wavelet_variance"]["regression"]["coefficients"]
    assert coefficients["time"]["unit"] == "m/yr"
    assert [entry["value"] for entry in coefficients.values()] == pytest.approx(
        [v / 1e3 for v in TRUTH.values()], abs=3e-3
    )
    assert "m²" in gmwm("fit", path, *reading, "-m", "WN").out
    for command in ("info", "wv", "allan", "psd", "select", "calibrate"):
        assert gmwm(command, path, *reading).code == 0


@pytest.mark.slow
@pytest.mark.parametrize("command", ["info", "select"])
def test_other_commands_take_them_too(gmwm, series, command):
    within = ("--within", "WN + FN") if command == "select" else ()
    assert gmwm(command, series, *OPTIONS[:2], *within, "--against", "time", "--against", "season:1y").code == 0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("season:20y", "the period of season:20y is longer than the recording of 10 years"),
        ("season:2d", "the period of season:2d is no longer than two samples"),
        ("step:2030-01-01", "step:2030-01-01 is outside the recording of 10 years, from 2014-01-01"),
        ("step:5000d", "step:5000d is outside the recording of 10 years"),
        ("step:2019-13-01", "must be a date such as step:2019-03-01T12:30; got 'step:2019-13-01'"),
        ("season:1q", "must be a duration such as"),
        ("seazon:1y", "--against must be season:1y, step:2000d, or a degree"),
        ("seazon", "there is no 'seazon' beside accel_x; known are time, warmup, season:1y, step:2000d"),
    ],
)
def test_errors_are_one_clear_line(gmwm, series, text, message):
    gmwm("fit", series, *OPTIONS, "--against", text).require_refusal(message)


def test_a_fit_comes_back_with_its_season_and_step():
    values, _ = _series(2)
    fit = library.fit("WN + FN", library.Signal(values, rate=1 / 86400), against="season:1y + step:2000d + time:2")
    again = library.Fit.from_dict(fit.to_dict())
    assert again.to_dict() == fit.to_dict()
    assert again.regression.summary() == fit.regression.summary()
    assert "zero at time 5 yr" in fit.regression.summary()
    assert fit.regression.plot().axes[0].get_xlabel() == "Time (h)"


@pytest.mark.slow
def test_a_long_recording_is_averaged_over_blocks_and_read_in_chunks(gmwm, tmp_path):
    rng = np.random.default_rng(5)
    t = np.arange(40_000) / 10
    slow = np.cumsum(0.02 * rng.standard_normal(t.size))
    values = rng.standard_normal(t.size) + slow + 3 * np.cos(2 * np.pi * t / 500) + 5.0 * (t >= 2000.35)
    regression = library.fit("WN + RW", library.Signal(values, 10.0), against="season:500s + step:2000.35").regression
    assert regression.block == 0.8
    for name, value in {"season:500s cos": 3.0, "season:500s sin": 0.0, "step:2000.35": 5.0}.items():
        low, high = regression[name].interval()
        assert low < value < high
    path = tmp_path / "long.csv"
    path.write_text("time,accel_x\n" + "".join(f"{a:.2f},{b!r}\n" for a, b in np.column_stack([t, values]).tolist()))
    parts = ("--model", "WN + RW", "--against", "season:500s", "--against", "step:2000.35", "--chunked", "yes")
    chunked = gmwm("fit", path, *OPTIONS[:2], *parts, "--json").json["axes"]["accel_x"]["wavelet_variance"]
    coefficients = chunked["regression"]["coefficients"]
    assert coefficients["step:2000.35"]["value"] == pytest.approx(regression["step:2000.35"].value, rel=1e-6)
