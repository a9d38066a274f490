"""Pictures of a ranking and of two of its candidates, as data and as drawn."""

from __future__ import annotations

import math

import numpy as np
import pytest

import gmwm
from gmwm.base.errors import OptionError
from gmwm.showing.plots.axes import signed_axis
from gmwm.showing.plots.figure import Axis, Band, Figure, Panel, Polyline, Stroke, Tick, description
from gmwm.showing.plots.matplotlib import draw
from gmwm.showing.plots.ranking import distance, plot_candidates, plot_ranking
from tests.helpers import raises


@pytest.fixture(scope="module")
def ranking():
    truth = gmwm.Model.parse("GM(beta=0.5, sigma2=6e-9) + WN(sigma2=7e-7) + QN(q2=2e-6) + RW(gamma2=1e-13)")
    signal = gmwm.Signal(truth.simulate(200_000, 250.0, rng=1), 250.0, "rad/s", "gyro_y")
    return gmwm.select("2*GM + WN + QN + RW", gmwm.wavelet_variance(signal))


@pytest.fixture(scope="module")
def several():
    x = gmwm.Model.parse("GM(beta=0.5, sigma2=1.0) + WN(sigma2=4.0)").simulate(40_000, 100.0, rng=3)
    return gmwm.select("GM + WN + RW", np.split(x, 2), 100.0)


def models(panel):
    """The lines of the models, which follow the levels."""
    return [line for line in panel.lines if line.stroke.width > 1 and line.x.size > 2]


@pytest.mark.slow
def test_the_curves_are_those_of_the_best_and_of_the_recommended(ranking):
    for limit in (1, 4):
        curves, distances, _ = description(plot_ranking)(ranking, limit=limit, view="wavelet", units="si").panels
        drawn = [c for k, c in enumerate(ranking.distinct) if k < limit or c.recommended]
        assert len(models(curves)) == len(models(distances)) == len(drawn)
        for line, row, candidate in zip(models(curves), models(distances), drawn, strict=True):
            np.testing.assert_array_equal(line.y, candidate.fit.implied)
            np.testing.assert_array_equal(line.x, candidate.fit.wavelet_variance.tau)
            np.testing.assert_array_equal(row.y, distance(candidate.fit.wavelet_variance, candidate.fit.implied))
            assert line.stroke.colour == row.stroke.colour
            assert line.stroke.dash == row.stroke.dash
        assert next(line for line in models(curves) if line.stroke.width > 2).stroke.dash == ()
    np.testing.assert_array_equal(curves["Wavelet variance"].y, ranking.best.fit.wavelet_variance.variance)


def test_no_two_curves_differ_by_colour_alone(ranking):
    _, distances, _ = description(plot_ranking)(ranking, limit=8).panels
    strokes = [line.stroke for line in models(distances)]
    assert len(strokes) == 8
    assert len({(s.dash, s.symbol) for s in strokes}) == 8
    assert len({line.label for line in models(distances)}) == 8


def test_a_distance_is_one_at_the_limits():
    wv = gmwm.WaveletVariance.from_values([4.0, 2.0, 1.0, 0.0], samples=100, rate=1.0)
    np.testing.assert_allclose(distance(wv, wv.upper)[:3], 1.0)
    np.testing.assert_allclose(distance(wv, wv.lower)[:3], -1.0)
    np.testing.assert_array_equal(distance(wv, wv.variance)[:3], 0.0)
    assert math.isnan(distance(wv, np.ones(4))[3])


def test_the_band_of_distances_is_that_of_the_data(ranking):
    curves, distances, _ = description(plot_ranking)(ranking).panels
    (band,) = distances.bands
    assert band.label == curves.bands[0].label == "95 % limits, any noise"
    np.testing.assert_array_equal(band.lower, [-1.0, -1.0])
    np.testing.assert_array_equal(band.upper, [1.0, 1.0])
    low, high = distances.y.limits
    drawn = np.concatenate([line.y for line in models(distances)])
    assert low < min(np.nanmin(drawn), -1)
    assert high > max(np.nanmax(drawn), 1)


def test_the_criteria_of_ten_stand_beside_their_models(ranking):
    figure = description(plot_ranking)(ranking)
    criteria = figure.panels[-1]
    listed = [c for k, c in enumerate(ranking.distinct) if k < 10 or c.equivalent]
    dots = [(line.x.item(), line.y.item()) for line in criteria.lines]
    assert [x for x, _ in dots] == [c.difference for c in listed]
    places = [y for _, y in dots]
    assert places == sorted(places, reverse=True)
    assert [tick.value for tick in criteria.y.ticks] == places
    assert [tick.label for tick in criteria.y.ticks] == [c.structure.replace("*", "·") for c in listed]
    numbers = {tick.value: tick.label for tick in criteria.y.opposite}
    assert numbers[places[0] + 1] == "WIC = loss + optimism"
    for place, candidate in zip(places, listed, strict=True):
        wic = candidate.wic
        assert numbers[place].startswith(f"{wic.value:.2f} = {wic.loss:.2f} + {wic.optimism:.2f}")
        assert numbers[place].endswith("recommended") == candidate.recommended
        assert numbers[place].endswith("equivalent") == (candidate.equivalent and not candidate.recommended)
    assert criteria.x.label == "WIC above the best"
    assert criteria.x.limits[0] < 0 < max(x for x, _ in dots) < criteria.x.limits[1]
    assert figure.title == "Gyroscope Y, models within 2·GM + WN + QN + RW"


def test_a_dot_has_the_colour_and_the_symbol_of_its_curve(ranking):
    _, distances, criteria = description(plot_ranking)(ranking, limit=3).panels
    drawn = [c for k, c in enumerate(ranking.distinct) if k < 3 or c.recommended]
    dots = {line.x.item(): line.stroke for line in criteria.lines}
    for row, candidate in zip(models(distances), drawn, strict=True):
        assert dots[candidate.difference].colour == row.stroke.colour
        assert dots[candidate.difference].symbol == row.stroke.symbol
    assert not criteria.lines[-1].stroke.filled


def test_several_recordings_say_so(several):
    figure = description(plot_ranking)(several, view="wavelet")
    assert figure.title.endswith("mean of 2 recordings")
    criteria = figure.panels[-1]
    assert criteria.x.label == "Loss out of sample above the best"
    texts = [tick.label for tick in criteria.y.opposite]
    assert texts[0].startswith(f"{several.best.out_of_sample:.2f}; ")
    assert texts[-1] == "Loss out of sample; WIC = loss + optimism"
    first = several.best.fit.wavelet_variance
    np.testing.assert_array_equal(figure.panels[0]["Wavelet variance"].y, first.variance)
    assert "Loss out of sample" in description(plot_candidates)(several.compare(0, 1)).title


def test_other_views_and_units(ranking):
    curves, distances, _ = description(plot_ranking)(ranking, view="allan", units="datasheet").panels
    assert curves.y.label == "Allan deviation (deg/h)"
    assert curves.x.label == distances.x.label == "Averaging time τ (s)"
    factor = np.degrees(1) * 3600
    np.testing.assert_allclose(models(curves)[0].y, factor * np.sqrt(2 * np.asarray(ranking.best.fit.implied)))
    with raises(OptionError, argument="view", got="hadamard"):
        ranking.plot(view="hadamard")


@pytest.mark.parametrize("limit", [0, 9, 2.0, True, "4"])
def test_limits_that_are_refused(ranking, limit):
    with raises(OptionError, argument="limit", expected="a whole number from 1 to 8", got=limit):
        plot_ranking(ranking, limit=limit)


def test_a_comparison_shows_both_and_their_difference(ranking):
    comparison = ranking.compare("GM + WN + QN + RW", "GM + WN + QN")
    figure = description(plot_candidates)(comparison, view="wavelet")
    curves, distances = figure.panels
    for panel in (curves, distances):
        assert len(models(panel)) == 2
    np.testing.assert_array_equal(models(curves)[0].y, comparison.first.fit.implied)
    np.testing.assert_array_equal(models(curves)[1].y, comparison.second.fit.implied)
    one, two = models(distances)
    assert one.label.startswith("GM + WN + QN + RW")
    assert two.label.startswith("GM + WN + QN")
    names, numbers = figure.title.split("\n")
    assert names == "GM + WN + QN + RW against GM + WN + QN"
    sign = "−" if comparison.difference < 0 else ""
    assert numbers.endswith(f"difference {sign}{abs(comparison.difference):.2f} ± {comparison.error:.2f}")
    assert f"WIC {comparison.first.wic.value:.2f} against {comparison.second.wic.value:.2f}" in numbers


def test_a_single_candidate_has_a_picture():
    ranking = gmwm.rank(["WN"], gmwm.WN(sigma2=1.0).simulate(1000, 10.0, rng=1), 10.0)
    figure = ranking.plot()
    assert [tick.get_text() for tick in figure.axes[2].get_yticklabels()] == ["WN"]
    assert "0.00 ± 0.00" in description(plot_candidates)(ranking.compare(0, 0)).title


@pytest.mark.slow
def test_it_is_drawn(ranking, several, tmp_path):
    figure = ranking.plot(path=tmp_path / "ranking.png")
    assert (tmp_path / "ranking.png").read_bytes().startswith(b"\x89PNG")
    curves, distances, criteria, *_ = figure.axes
    assert (curves.get_yscale(), distances.get_xscale()) == ("log", "log")
    assert criteria.get_xscale() == "symlog"
    assert criteria.get_yscale() == "linear"
    several.compare(0, 1).plot(path=tmp_path / "pair.pdf")
    assert (tmp_path / "pair.pdf").read_bytes().startswith(b"%PDF")
    ranking.plot(path=tmp_path / "again.png")
    assert (tmp_path / "again.png").read_bytes() == (tmp_path / "ranking.png").read_bytes()


@pytest.mark.slow
def test_every_word_is_inside_and_none_lies_on_another(ranking):
    figure = ranking.plot(limit=2)
    figure.draw_without_rendering()
    texts = [figure.axes[2].yaxis, *figure.axes[2].child_axes]
    boxes = [item.get_tightbbox() for item in texts]
    boxes += [ax.xaxis.label.get_window_extent() for ax in figure.axes[:3]]
    boxes += [ax.yaxis.label.get_window_extent() for ax in figure.axes[:2]]
    boxes += [figure.legends[0].get_window_extent()]
    assert len(boxes) == 8
    for box in boxes:
        assert box.x0 >= -1
        assert box.y0 >= -1
        assert box.x1 <= figure.bbox.x1 + 1
        assert box.y1 <= figure.bbox.y1 + 1
    assert not any(a.overlaps(b) for a in boxes[2:] for b in boxes[2:] if a is not b)


@pytest.mark.parametrize(
    ("values", "labels", "linear"),
    [
        ([], ["0", "0.2", "0.4", "0.6", "0.8", "1"], math.inf),
        ([0.3, -0.2], ["−0.2", "−0.1", "0", "0.1", "0.2", "0.3"], math.inf),
        ([0.0, 4.0], ["0", "1", "2", "3", "4"], math.inf),
        ([-3.0, 4.0, np.nan, np.inf], ["−2", "0", "2", "4"], math.inf),
        ([0.0, 30.0], ["0", "1", "2", "5", "10", "20"], 1.0),
        ([0.0, 2e5], ["0", "1", "10", "100", "1000", "10000", "100000"], 1.0),
        ([-150.0, 40.0], ["−100", "−10", "−1", "0", "1", "10"], 1.0),
    ],
)
def test_axes_about_zero(values, labels, linear):
    axis = signed_axis(np.array(values), "x", linear=1.0, even=5.0)
    assert [tick.label for tick in axis.ticks] == labels
    assert axis.linear == linear
    shown = [value for value in values if math.isfinite(value)] or [0.0]
    assert axis.limits[0] < min(0.0, *shown) <= max(0.0, *shown) < axis.limits[1]
    assert axis.grid == tuple(tick.value for tick in axis.ticks)


@pytest.mark.slow
def test_rows_of_two_lengths_share_the_width_and_the_height():
    axis = Axis("x", (0.0, 2.0), (Tick(1.0, "one"),), linear=math.inf)
    band = Band(np.array([0.0, 2.0]), np.full(2, -np.inf), np.full(2, 1.0), "#000000", label="low")
    panel = Panel(axis, axis, (band, Polyline(np.array([1.0]), np.array([1.0]), Stroke("#000000", symbol="cross"))))
    picture = draw(Figure(((panel, panel), (panel,)), heights=(2.0, 1.0)))
    picture.draw_without_rendering()
    left, right, low = (ax.get_window_extent() for ax in picture.axes)
    assert left.width == pytest.approx(right.width, rel=0.02)
    assert low.width > 2 * left.width
    assert left.height > 1.5 * low.height
    columns = draw(Figure(((panel,), (panel,)), heights=(3.0, 1.0)))
    columns.draw_without_rendering()
    top, below = (ax.get_window_extent() for ax in columns.axes)
    assert (top.x0, top.x1) == pytest.approx((below.x0, below.x1))
    assert top.height > 2 * below.height
