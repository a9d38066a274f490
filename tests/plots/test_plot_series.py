"""Signals over time: no extreme is lost, no gap is bridged, and every label says its unit."""

import math
import pickle
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import gmwm
from gmwm.base.errors import OptionError
from gmwm.recording.signals import Imu, Signal
from gmwm.showing.plots import plot_components, plot_recording, plot_signal
from gmwm.showing.plots.axes import even_axis, even_ticks, power_of, time_unit
from gmwm.showing.plots.figure import PAGE, description
from gmwm.showing.plots.series import DOTS_OF_MM, signal_panel
from gmwm.showing.plots.style import term_strokes
from gmwm.showing.plots.trace import extremes, trace
from tests.helpers import raises

FIXED = settings(derandomize=True, deadline=None, max_examples=60)


@pytest.fixture(scope="module")
def noise():
    return np.random.default_rng(4).normal(size=100_000)


@pytest.fixture(scope="module")
def recording():
    return gmwm.simulate(gmwm.simulation.reference_imu(), rate=100.0, samples=20_000, rng=2)


@pytest.fixture(scope="module")
def simulated():
    text = "3*GM(beta=0.5, sigma2=4e-7) + WN(sigma2=4e-7) + RW(gamma2=1e-13)"
    return gmwm.simulate({"gyro_x": text}, rate=100.0, samples=20_000, rng=1, components=True)["gyro_x"]


# --- which samples are drawn --------------------------------------------------------------------------


@FIXED
@given(n=st.integers(1, 3000), columns=st.integers(1, 50), seed=st.integers(0, 2**32), coarse=st.booleans())
def test_no_extreme_of_a_column_is_lost(n, columns, seed, coarse):
    values = np.random.default_rng(seed).normal(size=n)
    values = np.round(values) if coarse else values
    kept = extremes(values, columns)
    assert np.all(np.diff(kept) > 0)
    assert kept.size <= 4 * columns or n <= 4 * columns
    edges = np.linspace(0, n, columns + 1).astype(int) if n > 4 * columns else np.arange(n + 1)
    for first, last in pairwise(edges):
        inside = kept[(first <= kept) & (kept < last)]
        assert inside[0] == first
        assert inside[-1] == last - 1
        assert values[inside].min() == values[first:last].min()
        assert values[inside].max() == values[first:last].max()


def test_a_spike_of_one_sample_in_many_is_drawn(noise):
    values = noise.copy()
    values[77_777] = 40.0
    (line,) = signal_panel(Signal(values, 100.0, "rad/s")).lines
    assert line.x.size <= 4 * DOTS_OF_MM * PAGE
    assert line.y.max() == 40.0
    assert line.x[np.argmax(line.y)] == pytest.approx(777.77 / 60)


def test_few_samples_are_drawn_as_they_are():
    values = np.array([0.0, 3.0, -1.0, 2.0])
    (line,) = signal_panel(Signal(values, 2.0, "rad/s", start=5.0)).lines
    np.testing.assert_array_equal(line.x, [0.0, 0.5, 1.0, 1.5])
    np.testing.assert_array_equal(line.y, values)
    assert line.stroke.symbol == "circle"


# --- gaps ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("length", [600, 90_000])
def test_a_gap_is_not_bridged(noise, length):
    cut = length // 3
    gap = length / 100 / 4
    starts = (1e9, 1e9 + cut / 100 + gap)
    signal = Signal(noise[:length], 100.0, "rad/s", segments=((0, cut), (cut, length)), starts=starts)
    (line,) = signal_panel(signal).lines
    assert np.count_nonzero(np.isnan(line.y)) == 1
    size = time_unit(length / 100 + gap)[1]
    before, after = (cut - 1) / 100 / size, (cut / 100 + gap) / size
    steps = np.diff(line.x)
    joined = np.isfinite(line.y[:-1]) & np.isfinite(line.y[1:])
    assert np.max(steps[joined]) < (after - before) / 20
    assert not np.any((line.x > before + 1e-9) & (line.x < after - 1e-9))


def test_samples_on_both_sides_of_a_gap_too_small_to_see_keep_their_extremes(noise):
    n = 90_000
    segments = tuple((k, k + 100) for k in range(0, n, 100))
    signal = Signal(noise[:n], 100.0, "rad/s", segments=segments)
    assert len(signal.segments) == 900
    shown = trace(signal, 1.0, 200)
    assert shown.y.size <= 4 * 200
    assert (np.nanmin(shown.y), np.nanmax(shown.y)) == (noise[:n].min(), noise[:n].max())


def test_a_sample_without_neighbours_is_a_dot(noise):
    segments = ((0, 1000), (1000, 1001), (1001, 2000))
    signal = Signal(noise[:2000], 100.0, "rad/s", segments=segments, starts=(0.0, 30.0, 60.0))
    line, dot = signal_panel(signal).lines
    assert np.count_nonzero(np.isnan(line.y)) == 2
    assert (dot.x.tolist(), dot.y.tolist()) == ([30.0], [noise[1000]])
    assert (dot.stroke.width, dot.stroke.symbol) == (0.0, "circle")


def test_a_clock_that_steps_back_is_not_joined(noise):
    signal = Signal(noise[:200], 100.0, "rad/s", segments=((0, 100), (100, 200)), starts=(10.0, 5.0))
    panel = signal_panel(signal)
    assert np.count_nonzero(np.isnan(panel.lines[0].y)) == 1
    # As one sample after the other, which is how --skip counts.
    times = panel.lines[0].x[np.isfinite(panel.lines[0].y)]
    assert np.all(np.diff(times) > 0)


# --- labels, units, means -----------------------------------------------------------------------------


@pytest.mark.slow
def test_labels_have_units(recording, simulated):
    panels = [*description(plot_recording)(recording).panels, *description(plot_components)(simulated).panels]
    assert len(panels) == 6 + 6
    assert {panel.y.label for panel in panels[:6]} == {"Angular rate (10⁻³ rad/s)", "Specific force (10⁻³ m/s²)"}
    assert {panel.y.label for panel in panels[6:]} == {"10⁻³ rad/s"}
    times = [panel.x.label for panel in panels if panel.x.label]
    assert times == ["Time since the first sample (s)"] * 3
    assert "unit of the data" in signal_panel(Signal([1.0, 2.0, 3.0], 1.0)).y.label


@pytest.mark.parametrize(("units", "unit"), [("si", "m/s²"), ("datasheet", "mg")])
def test_what_is_said_of_the_mean_is_what_is_done(recording, units, unit):
    figure = description(plot_recording)(recording, units=units)
    panel = figure.rows[2][1]
    title, _, said = panel.title.partition(" less its mean of ")
    assert (title, said.split()[1]) == ("Accelerometer Z", unit)
    factor = 1.0 if units == "si" else 1000 / 9.80665
    values = recording["accel_z"].values * factor
    scale = 1e-3 if "10⁻³" in panel.y.label else 1.0
    (line,) = panel.lines
    assert line.y.max() * scale == pytest.approx(values.max() - float(said.split()[0]), rel=1e-9)
    assert line.y.min() * scale == pytest.approx(values.min() - float(said.split()[0]), rel=1e-9)
    assert abs(np.mean(values) - float(said.split()[0])) < 0.01 * np.ptp(values)


def test_a_mean_that_is_near_zero_stays(recording):
    titles = [panel.title for panel in description(plot_recording)(recording).panels]
    assert titles[:2] == ["Gyroscope X", "Accelerometer X"]
    assert sum("less" in title for title in titles) == 1


def test_axes_of_a_sensor_have_one_scale_unless_one_would_be_flat(noise):
    def limits(small):
        imu = Imu.from_arrays({"gyro_x": noise[:1000], "gyro_y": small * noise[1000:2000]}, 100.0)
        return [panel.y.limits for panel in description(plot_recording)(imu).panels]

    assert len(set(limits(0.5))) == 1
    assert len(set(limits(0.01))) == 2


@pytest.mark.parametrize("scale", [1e-12, 1.0, 1e9])
def test_all_of_a_signal_is_inside_whatever_its_scale(noise, scale):
    panel = signal_panel(Signal(scale * noise[:5000], 100.0, "rad/s"))
    (line,) = panel.lines
    assert panel.y.limits[0] < line.y.min() < line.y.max() < panel.y.limits[1]
    assert panel.x.limits[0] < line.x.min() < line.x.max() < panel.x.limits[1]
    assert 2 <= len(panel.y.ticks) <= 5
    assert max(abs(tick.value) for tick in panel.y.ticks) < 1e4


@pytest.mark.slow
@pytest.mark.parametrize("value", [0.0, 9.80665, -3e-9, 1 / 3])
def test_a_constant_can_be_drawn(value, tmp_path):
    signal = Signal(np.full(100, value), 100.0, "m/s²", "accel_z")
    panel = signal_panel(signal)
    assert panel.y.limits[0] < panel.lines[0].y[0] < panel.y.limits[1]
    signal.plot(path=tmp_path / "constant.png")
    Signal([value], 1.0).plot(path=tmp_path / "one.png")


@FIXED
@given(low=st.floats(-1e6, 1e6), span=st.floats(1e-6, 1e6), at_most=st.integers(3, 12))
def test_ticks_are_inside_evenly_spaced_and_say_their_value(low, span, at_most):
    ticks = even_ticks((low, low + span), at_most)
    values = np.array([tick.value for tick in ticks])
    assert 1 <= len(ticks) <= at_most
    tiny = 1e-9 * max(abs(low), span)
    assert np.all((values >= low - tiny) & (values <= low + span + tiny))
    steps = np.diff(values)
    assert np.allclose(steps, steps[:1], rtol=1e-6)
    said = [float(tick.label.replace("−", "-")) for tick in ticks]
    assert said == pytest.approx(values.tolist(), rel=1e-9, abs=tiny)
    assert len({tick.label for tick in ticks}) == len(ticks)


def test_time_reads_well():
    for seconds, unit in ((1e-4, "µs"), (0.1, "ms"), (60.0, "s"), (1800.0, "min"), (86400.0, "h"), (1e6, "d")):
        assert time_unit(seconds)[0] == unit
    assert even_axis(0.0, 100.0, "t", margin=0.01).limits == (-1.0, 101.0)
    assert (power_of(math.pi * 1e-5), power_of(9999.0), power_of(10_001.0)) == (-6, 0, 3)


def test_datasheet_units_need_a_unit(noise):
    with raises(OptionError, "no unit", argument="units", got="datasheet"):
        Signal(noise[:100], 1.0).plot(units="datasheet")


# --- latent processes ---------------------------------------------------------------------------------


def test_the_panels_of_the_terms_add_up_to_that_of_the_signal():
    short = gmwm.simulate_signal("2*GM(beta=0.1, sigma2=1) + WN(sigma2=4)", rate=1.0, samples=200, rng=3, unit="m")
    signal, *terms = description(plot_components)(short).panels
    assert signal.title == "Signal: 2·GM + WN"
    assert [panel.title.split(":")[0] for panel in terms] == ["GM[1]", "GM[2]", "WN"]
    total = sum(panel.lines[0].y for panel in terms)
    np.testing.assert_allclose(total, signal.lines[0].y, rtol=0, atol=1e-12 * np.abs(total).max())


def test_gravity_and_rounding_are_said():
    models = {"accel_z": "WN(sigma2=1e-4)"}
    made = gmwm.simulate(models, rate=10.0, samples=100, rng=1, resolution={"accel": 0.01}, components=True)
    signal, term = description(plot_components)(made["accel_z"]).panels
    assert signal.title == "Accelerometer Z less 9.80665 m/s²: WN, in steps of 0.01 m/s²"
    assert np.abs(signal.lines[0].y - term.lines[0].y).max() <= 0.005 * (1 + 1e-9) * (
        1000 if "10⁻³" in term.y.label else 1
    )


def test_terms_have_their_colours(simulated):
    strokes = term_strokes(simulated.model.terms, simulated.model.processes)
    panels = description(plot_components)(simulated).panels[1:]
    assert [panel.lines[0].stroke.colour for panel in panels] == [
        strokes[term].colour for term in simulated.model.terms
    ]


# --- pictures -----------------------------------------------------------------------------------------


@pytest.mark.slow
def test_pictures_are_written(recording, simulated, tmp_path):
    plot_signal(recording["gyro_x"], path=tmp_path / "signal.png")
    plot_recording(recording, path=tmp_path / "recording.pdf")
    plot_components(simulated, path=tmp_path / "components.svg")
    starts = [path.read_bytes()[:4] for path in sorted(tmp_path.iterdir())]
    assert starts == [b"<?xm", b"%PDF", b"\x89PNG"]


@pytest.mark.slow
def test_signals_draw_themselves(recording, simulated):
    assert recording["gyro_y"].plot(units="datasheet").axes[0].get_ylabel() == "Angular rate (deg/h)"
    assert len(recording.plot().axes) == 6
    assert len(pickle.loads(pickle.dumps(simulated)).plot().axes) == 6
    picture = gmwm.Signal([1.0, 2.0, 4.0], 1.0).plot()
    assert not picture.legends


@pytest.mark.slow
def test_a_signal_on_axes_of_the_caller(recording):
    from matplotlib.figure import Figure

    mine = Figure()
    axes = mine.add_subplot()
    assert recording["gyro_x"].plot(ax=axes) is mine
    assert axes.get_legend() is None
    (line,) = axes.get_lines()
    np.testing.assert_array_equal(line.get_ydata(), signal_panel(recording["gyro_x"]).lines[0].y)


def test_a_recording_of_some_axes_has_no_empty_row(noise):
    imu = Imu.from_arrays({"gyro_x": noise[:100], "accel_x": noise[:100], "accel_z": noise[:100]}, 10.0)
    figure = description(plot_recording)(imu)
    assert [[panel is not None for panel in row] for row in figure.rows] == [[True, True], [False, True]]
    assert [bool(panel.x.label) for panel in figure.panels] == [True, False, True]
    other = Imu({"pressure": Signal(noise[:100], 10.0, "Pa"), "flow": Signal(noise[:100], 10.0, "m/s")})
    assert [panel.y.label for panel in description(plot_recording)(other).panels] == ["Signal (Pa)", "Signal (m/s)"]


def test_a_knock_does_not_flatten_the_other_samples():
    values = np.random.default_rng(1).normal(9.8, 0.01, 20_000)
    values[5000:5010] += 30.0
    imu = gmwm.Imu.from_arrays({"accel_z": values}, rate=100.0)
    ((panel,),) = description(plot_recording)(imu).rows
    line, *marks = panel.marks
    # The mean is that of the other samples, and the panel is as high as a few of their spans.
    assert "less its mean of 9.8" in panel.title
    assert "Beyond the limits" in panel.labels
    assert np.ptp(line.y[np.isfinite(line.y)]) < 40 * np.std(line.y[line.y < np.quantile(line.y, 0.99)])
    assert [mark.stroke.symbol for mark in marks] == ["triangle"]
    assert np.all((marks[0].x > 0.8) & (marks[0].x < 51))
    calm = gmwm.Imu.from_arrays({"accel_z": np.delete(values, range(5000, 5010))}, rate=100.0)
    ((panel,),) = description(plot_recording)(calm).rows
    assert len(panel.marks) == 1
    assert "beyond" not in panel.title


@pytest.mark.slow
def test_samples_of_findings_are_marked():
    rng, n = np.random.default_rng(3), 30_000
    noise = 1e-3 * rng.normal(size=(4, n))
    clipped = np.minimum(noise[0], 1.5e-3)
    wrong = noise[1].copy()
    wrong[[7_000, 21_000]] += 0.1
    jump = noise[2] + 1e-3 * (np.arange(n) >= 12_000)
    frozen = noise[3][np.maximum.accumulate(np.where(np.arange(n) % 3000 < 100, 0, np.arange(n)))]
    axes = {"gyro_x": clipped, "gyro_y": wrong, "gyro_z": jump}
    recordings = [axes, {"gyro_x": frozen}]
    labels = []
    for values in recordings:
        imu = Imu({axis: Signal(x, 100.0, "rad/s", axis=axis) for axis, x in values.items()})
        figure = description(plot_recording)(imu, inspection=gmwm.inspect(imu))
        labels.append(set(figure.labels))
        plain = description(plot_recording)(imu)
        assert "Clipped" not in plain.labels
        assert figure.height >= plain.height
        if "gyro_y" in values:
            panels = dict(zip(values, figure.panels, strict=True))
            assert np.all(panels["gyro_x"]["Clipped"].y == np.max(panels["gyro_x"]["Clipped"].y))
            assert len(panels["gyro_y"]["Wrong sample"].x) == 2
            time = panels["gyro_z"]["Jump"].x[0] / panels["gyro_z"].x.limits[1]
            assert time == pytest.approx(0.4, abs=0.02)
    assert {"Clipped", "Wrong sample", "Jump"} <= labels[0]
    assert "Frozen" in labels[1]
