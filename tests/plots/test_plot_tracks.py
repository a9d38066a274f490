"""Hidden processes over time: at their own scale, through gaps, and only where something is known of them."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import gmwm
from gmwm.base.errors import DataError, OptionError
from gmwm.recording.signals import Signal
from gmwm.showing.plots.figure import Band, Polyline
from gmwm.showing.plots.likelihood import COLUMNS, plot_tracks, tracks_figure
from gmwm.showing.plots.trace import envelope, even_trace, extremes_there, lone_values
from tests.helpers import raises

FIXED = settings(derandomize=True, deadline=None, max_examples=60)
MODEL = gmwm.Model.parse("GM(beta=0.2, sigma2=4e-8) + WN(sigma2=4e-6)")
GAP = slice(9_000, 11_000)
RATE = 100.0


@pytest.fixture(scope="module")
def made():
    return gmwm.simulate_signal(MODEL, rate=RATE, samples=20_000, rng=5, unit="rad/s")


@pytest.fixture(scope="module")
def gapped(made):
    """A gyroscope with an offset and a gap of 20 s."""
    values, last = made.signal.values + 0.01, GAP.stop / RATE
    kept = np.concatenate([values[: GAP.start], values[GAP.stop :]])
    parts = ((0, GAP.start), (GAP.start, kept.size))
    return Signal(kept, RATE, "rad/s", "gyro_x", segments=parts, starts=(0.0, last))


@pytest.fixture(scope="module")
def smoothed(gapped):
    return MODEL.smooth(gapped)


@pytest.fixture(scope="module")
def filtered(gapped):
    return MODEL.kalman_filter(gapped)


def parts(panel):
    """The line and the band of a panel."""
    (band,) = panel.bands
    return panel.lines[0], band


# --- which samples are drawn --------------------------------------------------------------------------


def gappy(n, seed, coarse):
    rng = np.random.default_rng(seed)
    values = rng.normal(size=n)
    values = np.round(values) if coarse else values
    for start in rng.integers(0, n, size=3):
        values[start : start + rng.integers(1, max(2, n // 4))] = math.nan
    return values


@FIXED
@given(n=st.integers(1, 3000), columns=st.integers(1, 50), seed=st.integers(0, 2**32), coarse=st.booleans())
def test_of_what_is_there_no_extreme_of_a_column_is_lost(n, columns, seed, coarse):
    values = gappy(n, seed, coarse)
    kept = extremes_there(values, columns)
    assert np.all(np.diff(kept) > 0)
    assert kept.size <= 4 * columns or n <= 4 * columns
    edges = np.linspace(0, n, columns + 1).astype(int) if n > 4 * columns else np.arange(n + 1)
    for first, last in pairwise(edges):
        inside, there = values[kept[(first <= kept) & (kept < last)]], values[first:last]
        there = there[np.isfinite(there)]
        if there.size == 0:
            assert np.all(np.isnan(inside))
            assert inside.size
            continue
        inside = inside[np.isfinite(inside)]
        assert (inside[0], inside[-1]) == (there[0], there[-1])
        assert (inside.min(), inside.max()) == (there.min(), there.max())


@FIXED
@given(n=st.integers(1, 3000), columns=st.integers(1, 50), seed=st.integers(0, 2**32))
def test_an_envelope_holds_the_band(n, columns, seed):
    centre = gappy(n, seed, coarse=False)
    reach = np.random.default_rng(seed).exponential(size=n)
    reach[: n // 7] = math.inf
    place, low, high = envelope(centre - reach, centre + reach, columns)
    known = np.isfinite(centre) & np.isfinite(reach)
    assert place.size == low.size == high.size == min(n, columns)
    assert place[0] == 0
    assert columns == 1 or place[-1] == n - 1
    edges = np.linspace(0, n, min(n, columns) + 1).astype(int)
    for k, (first, last) in enumerate(pairwise(edges)):
        run = slice(first, last)
        if not np.any(known[run]):
            assert np.isnan(low[k])
            assert np.isnan(high[k])
            continue
        assert low[k] == np.min((centre - reach)[run][known[run]])
        assert high[k] == np.max((centre + reach)[run][known[run]])


def test_a_spike_of_one_sample_in_many_is_drawn():
    values = np.random.default_rng(1).normal(size=300_000)
    values[1000:5000] = math.nan
    values[177_777] = 40.0
    shown = even_trace(values, 10.0, 2.0, 500)
    assert (shown.high, shown.y.size <= 2000) == (80.0, True)
    assert shown.seconds[np.nanargmax(shown.y)] == pytest.approx(17_777.7)
    assert shown.mean == pytest.approx(2 * np.nanmean(values))


# --- gaps and what is not known -----------------------------------------------------------------------


def test_a_gap_breaks_the_record_and_not_the_track(smoothed):
    record, bias = tracks_figure(smoothed).panels
    data, over = record.lines
    first, last = (GAP.start - 1) / RATE, GAP.stop / RATE
    assert np.count_nonzero(np.isfinite(data.y[(data.x > first + 1e-9) & (data.x < last - 1e-9)])) == 0
    assert data.x[np.isfinite(data.y)].max() == pytest.approx(199.99)
    line, band = parts(bias)
    for drawn in (over, line):
        assert np.all(np.isfinite(drawn.y))
        assert np.count_nonzero((drawn.x > first) & (drawn.x < last)) > 20
    width = band.upper - band.lower
    middle = width[np.argmin(np.abs(band.x - (first + last) / 2))]
    assert middle > 1.5 * np.median(width)


def test_what_is_infinitely_uncertain_is_not_drawn():
    walk = gmwm.Model.parse("WN(sigma2=1.0) + RW(gamma2=1e-4)")
    x = walk.simulate(3000, RATE, rng=2)
    x[:300] = math.nan
    record, bias = tracks_figure(walk.kalman_filter(x, RATE)).panels
    line, band = parts(bias)
    assert np.isnan(line.y).sum() == np.isnan(record.lines[1].y).sum() == 300
    # The band has an envelope of its own, in which a column is at most two samples wide.
    assert np.all(np.isnan(band.lower[band.x < 2.97]))
    assert np.all(np.isfinite(band.lower[band.x > 3.01]))


def test_a_lone_sample_is_a_dot():
    x = MODEL.simulate(200, RATE, rng=2)
    x[[50, 52]] = math.nan
    record = tracks_figure(MODEL.smooth(x, RATE)).panels[0]
    dots = [line for line in record.lines if line.stroke.symbol]
    assert [(dot.x.tolist(), dot.stroke.width) for dot in dots] == [([0.51], 0.0)]
    assert lone_values(np.array([math.nan, 1.0])).tolist() == [False, True]


# --- scales and units ---------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("method", ["kalman_filter", "smooth"])
@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e9])
def test_a_panel_shows_the_band_and_is_not_scaled_by_the_record(made, method, scale):
    model = gmwm.Model.parse(f"GM(beta=0.2, sigma2={4e-8 * scale**2}) + WN(sigma2={4e-6 * scale**2})")
    tracks = getattr(model, method)(Signal(scale * made.signal.values, RATE, "rad/s"))
    record, bias = tracks_figure(tracks).panels
    line, band = parts(bias)
    settled = band.x > 20
    low, high = bias.y.limits
    assert low < np.min(band.lower[settled]) < np.max(band.upper[settled]) < high
    assert high - low < 3 * (np.max(band.upper[settled]) - np.min(band.lower[settled]))
    assert low < np.min(line.y[line.x > 20]) < np.max(line.y[line.x > 20]) < high
    powers = [1e-6 if "10⁻⁶" in panel.y.label else 1.0 for panel in (record, bias)]
    if scale == 1.0:
        assert powers == [1.0, 1e-6]
        assert "(10⁻³ rad/s)" in record.y.label
        assert powers[1] * (high - low) < 0.2 * 1e-3 * np.ptp(record.y.limits)


@pytest.mark.parametrize(("units", "unit"), [("si", "m/s²"), ("datasheet", "mg")])
def test_what_is_said_to_be_taken_off_is_taken_off(made, units, unit):
    signal = Signal(9.80665 + made.signal.values, RATE, "m/s²", "accel_z")
    tracks = MODEL.smooth(signal)
    factor = 1.0 if units == "si" else 1000 / 9.80665
    figure = tracks_figure(tracks, ["bias", "GM", "level"], truth={"level": np.full(20_000, 9.80665)}, units=units)
    record, bias, term, level = figure.panels
    for panel, values in ((record, tracks.data), (bias, tracks.mean["bias"]), (level, tracks.mean["level"])):
        _, _, said = panel.title.partition(", less ")
        assert said.split()[1] == unit
        shift = float(said.split()[0])
        scale = next((s for t, s in (("10⁻³", 1e-3), ("10⁻⁶", 1e-6)) if t in panel.y.label), 1.0)
        assert np.nanmax(panel.lines[0].y) * scale == pytest.approx(np.max(values) * factor - shift, rel=1e-6)
        assert max(map(abs, panel.y.limits)) < 1e4
    assert "less" not in term.title
    assert level.lines[1].y[0] == pytest.approx(level.lines[1].y[-1])


@pytest.mark.slow
def test_labels_have_units_and_the_lowest_panel_the_time(smoothed):
    figure = tracks_figure(smoothed, ["bias", "WN", "GM"])
    record, bias, white, term = figure.panels
    assert (record.title, bias.title) == ("Gyroscope X and its bias: GM + WN", "Bias: level + GM")
    assert term.title.startswith("GM: T = 5 s, σ = 2×10⁻⁴ rad/s")
    assert [bool(panel.x.label) for panel in figure.panels] == [False, False, False, True]
    assert term.x.label == "Time since the first sample (s)"
    assert white.y.label == "Angular rate (10⁻³ rad/s)"
    assert figure.labels == ("Record", "Smoothed", "95 % interval")
    assert tracks_figure(smoothed, units="datasheet").panels[1].y.label == "Angular rate (deg/h)"
    assert "unit of the data" in tracks_figure(MODEL.smooth(smoothed.data, RATE)).panels[1].y.label


def test_times_are_those_of_a_clock_since_1970(gapped):
    late = Signal(
        gapped.values, RATE, "rad/s", segments=gapped.segments, starts=tuple(1.7e9 + s for s in gapped.starts)
    )
    line, _ = parts(tracks_figure(MODEL.smooth(late)).panels[1])
    assert (line.x[0], line.x[-1]) == (0.0, pytest.approx(199.99, rel=1e-12))


def test_the_level_of_a_band_is_its_width(smoothed):
    widths = []
    for level in (0.5, 0.95):
        figure = tracks_figure(smoothed, level=level)
        _, band = parts(figure.panels[1])
        assert band.label == f"{100 * level:g} % interval"
        widths.append(np.median(band.upper - band.lower))
    assert widths[1] / widths[0] == pytest.approx(1.959964 / 0.674490, rel=0.2)


# --- predictions, truths ------------------------------------------------------------------------------


def test_a_prediction_widens_from_the_end_of_the_record(gapped):
    (panel,) = tracks_figure(MODEL.predict(gapped, 1500)).panels
    line, band = parts(panel)
    assert (line.x[0], line.x[-1]) == pytest.approx((0.01, 15.0))
    assert band.x[0] == pytest.approx(0.01)
    assert panel.x.label == "Time since the end of the record (s)"
    width = band.upper - band.lower
    assert np.all(np.diff(width) > 0)
    assert panel.y.limits[0] < band.lower.min() < band.upper.max() < panel.y.limits[1]


@pytest.mark.slow
def test_the_truth_lies_over_the_track_unless_it_would_hide_it(made, smoothed):
    true = 0.01 + made["GM"].values
    bias = tracks_figure(smoothed, truth=true).panels[1]
    truth = bias["Truth"]
    assert isinstance(truth, Polyline)
    assert truth.layer > bias["Smoothed"].layer
    scale = 1e-3 if "10⁻³" in bias.y.label else 1.0
    assert truth.y.max() * scale == pytest.approx(true.max())
    assert bias.y.limits[0] < truth.y.min() < truth.y.max() < bias.y.limits[1]
    white = tracks_figure(smoothed, "WN", truth={"WN": made["WN"], "GM": made["GM"]}).panels[1]
    assert white["Truth"].layer < white["95 % interval"].layer < white["Smoothed"].layer
    assert isinstance(white["95 % interval"], Band)


def test_a_truth_has_to_fit(smoothed):
    with raises(OptionError, "bias", "20000 samples", argument="truth", got=5):
        smoothed.plot(truth=np.zeros(5))
    with raises(OptionError, "GM, WN, level, bias", argument="truth", got="RW"):
        smoothed.plot(truth={"RW": np.zeros(20_000)})
    with raises(DataError, argument="truth of bias"):
        smoothed.plot(truth=["a"] * 20_000)


def test_options_that_cannot_be(smoothed):
    for labels in ("RW", ["bias", "RW"]):
        with raises(OptionError, "GM, WN, level, bias", argument="labels", got="RW"):
            smoothed.plot(labels)
    with raises(OptionError, argument="labels", got=[]):
        smoothed.plot([])
    with raises(OptionError, argument="level", got=95):
        smoothed.plot(level=95)
    with raises(OptionError, argument="units", got="imperial"):
        smoothed.plot(units="imperial")


# --- pictures -----------------------------------------------------------------------------------------


@pytest.mark.slow
def test_pictures_are_written(smoothed, filtered, gapped, tmp_path):
    smoothed.plot(path=tmp_path / "smoothed.png")
    filtered.plot(["GM", "bias"], path=tmp_path / "filtered.svg")
    MODEL.predict(gapped, 100).plot(path=tmp_path / "ahead.pdf")
    starts = [path.read_bytes()[:4] for path in sorted(tmp_path.iterdir())]
    assert starts == [b"%PDF", b"<?xm", b"\x89PNG"]
    assert len(plot_tracks(smoothed).axes) == 2


def test_one_track_on_axes_of_the_caller(smoothed):
    from matplotlib.figure import Figure

    mine = Figure()
    axes = mine.add_subplot()
    assert smoothed.plot("GM", ax=axes) is mine
    assert axes.get_title().startswith("GM: T")
    assert axes.get_legend() is not None
    with raises(OptionError, "2 panels", argument="ax", got=axes, advises=["ax="]):
        smoothed.plot(["GM", "bias"], ax=axes)


@pytest.mark.slow
def test_long_records_are_drawn_by_few_points():
    model = gmwm.Model.parse("WN(sigma2=1.0) + RW(gamma2=1e-6)")
    for panel in tracks_figure(model.smooth(model.simulate(400_000, RATE, rng=1), RATE)).panels:
        for line in panel.lines:
            assert line.x.size <= 4 * COLUMNS
        for band in panel.bands:
            assert band.x.size <= COLUMNS
