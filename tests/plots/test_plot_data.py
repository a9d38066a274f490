import re
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

import gmwm
from gmwm.base.errors import OptionError
from gmwm.showing.plots.curves import ABOVE, overlay_panel, wavelet_variance_panel
from gmwm.showing.plots.figure import description
from gmwm.showing.plots.fit import fit_panel
from gmwm.showing.plots.imu import plot_imu
from gmwm.showing.plots.style import GREY, curve_stroke, letter_stroke, term_stroke, term_strokes
from gmwm.theory.processes import registry
from tests.helpers import raises


def test_the_curve_and_its_band_are_the_numbers_of_the_result(wv):
    panel = wavelet_variance_panel(wv, view="wavelet")
    line, band = panel["Wavelet variance"], panel["95 % limits, any noise"]
    np.testing.assert_array_equal(line.x, wv.tau)
    np.testing.assert_array_equal(line.y, wv.variance)
    np.testing.assert_array_equal(band.lower, wv.lower)
    np.testing.assert_array_equal(band.upper, wv.upper)
    np.testing.assert_array_equal(panel.x.grid, wv.tau)
    assert panel.title == "Gyroscope Y"


def test_the_allan_view(wv):
    panel = wavelet_variance_panel(wv, view="allan", units="si")
    line = panel["Allan deviation"]
    np.testing.assert_array_equal(line.x, wv.tau / 2)
    np.testing.assert_allclose(line.y, np.sqrt(2 * wv.variance), rtol=1e-15)
    assert panel.y.label == "Allan deviation (rad/s)"


def test_the_allan_view_is_for_haar_only(wv):
    with raises(OptionError, "Haar", "d4", argument="view", got="allan", advises=["view='wavelet'", "filter='haar'"]):
        wavelet_variance_panel(replace(wv, filter="d4"), view="allan")
    assert wavelet_variance_panel(replace(wv, filter="d4")).lines


def test_the_default_is_what_the_field_reads(wv, scaled):
    assert wavelet_variance_panel(wv).y.label == "Allan deviation (deg/h)"
    assert wavelet_variance_panel(scaled(wv, unit="counts")).y.label == "Allan deviation (counts)"
    assert wavelet_variance_panel(wv, view="wavelet").y.label == "Wavelet variance (rad²/s²)"
    assert wavelet_variance_panel(wv, units="si").y.label == "Allan deviation (rad/s)"
    assert wavelet_variance_panel(replace(wv, filter="d4")).y.label == "Wavelet variance (rad²/s²)"


def test_robust_and_confidence_are_named(wv):
    labels = wavelet_variance_panel(replace(wv, robust=True, confidence=0.9)).labels
    assert labels == ("Allan deviation, robust", "90 % limits, any noise")


@pytest.mark.parametrize("scale", [1e-12, 1.0, 1e12])
@pytest.mark.parametrize("view", ["wavelet", "allan"])
def test_the_whole_curve_is_inside_whatever_the_scale(wv, scale, view, scaled):
    panel = wavelet_variance_panel(scaled(wv, variance=wv.variance * scale**2), view=view)
    y = panel.lines[0].y
    assert np.all((panel.y.limits[0] < y) & (y < panel.y.limits[1]))
    assert np.all((panel.x.limits[0] < panel.lines[0].x) & (panel.lines[0].x < panel.x.limits[1]))
    assert len(panel.y.ticks) >= 2


def test_zeros_are_marked_and_counted(wv, scaled):
    values = wv.variance.copy()
    values[[2, 5]] = 0.0
    panel = wavelet_variance_panel(scaled(wv, variance=values), view="wavelet")
    (foot,) = panel.feet
    np.testing.assert_array_equal(foot.x, wv.tau[[2, 5]])
    assert foot.label == "Zero at 2 of 20 scales"
    np.testing.assert_array_equal(np.isnan(panel.lines[0].y), values == 0)
    np.testing.assert_array_equal(np.isnan(panel.bands[0].lower), values == 0)


def test_a_constant_signal_says_so(wv, scaled):
    panel = wavelet_variance_panel(scaled(wv, variance=np.zeros(5)))
    assert [text.text for text in panel.texts] == ["Every variance is zero"]
    assert panel.feet[0].x.size == 5


def test_an_unbounded_limit_does_not_move_the_axes(wv):
    free = wavelet_variance_panel(replace(wv, upper=np.where(wv.levels == 20, np.inf, wv.upper)), view="wavelet")
    assert np.isposinf(free.bands[0].upper[-1])
    assert free.y.limits[1] < 20 * wv.variance.max()


def test_a_fit_shows_the_model_and_every_term(fit):
    panel = fit_panel(fit, view="wavelet")
    np.testing.assert_array_equal(panel["Model: GM + WN + QN + RW"].y, fit.implied)
    for term, variance in fit.decomposition.items():
        (line,) = [line for line in panel.lines if line.label.startswith(f"{term}: ")]
        np.testing.assert_array_equal(line.y, variance)
    assert any("T = 2 s, σ = 7.7×10⁻⁵ rad/s" in label for label in panel.labels)


@pytest.mark.parametrize("view", ["wavelet", "allan"])
def test_in_datasheet_units_the_legend_gives_the_numbers_of_the_datasheet(fit, view):
    labels = {label.split(":")[0]: label for label in fit_panel(fit, view=view, units="datasheet").labels}
    numbers = [entry for entry in fit.datasheet().values() if entry.term]
    assert {entry.symbol for entry in numbers} == {"N of WN", "Q", "K of RW", "T_c", "q_c"}
    for entry in numbers:
        value, _, _, unit = entry.in_units()
        shown = re.search(rf"\b{entry.symbol.partition(' of ')[0]} = (\S+) {unit}(,|$)", labels[entry.term])
        assert shown, entry
        assert float(shown[1]) == pytest.approx(value, rel=0.05)


def test_a_term_without_such_numbers_keeps_its_parameters_in_datasheet_units():
    model = gmwm.Model.parse("AR(phi=[0.5, 0.2], sigma2=1e-7) + WN(sigma2=4e-4)")
    # At 1 Hz, AR(2) has a correlation time above 1 s, so that it is no band-limited white noise.
    exact = gmwm.WaveletVariance.from_values(model.wavelet_variance(12, 1.0), 100_000, 1.0, unit="deg/s")
    labels = fit_panel(gmwm.fit(model, exact), units="datasheet").labels
    assert any(label.startswith("AR(2): φ₁ = ") for label in labels), labels
    # √(4e-4 / 1 Hz) deg/s/√Hz, by 60.
    assert "WN: N = 1.2 deg/√h" in labels


def test_a_fit_without_its_terms(fit):
    assert fit_panel(fit, decomposition=False).labels == (
        "Allan deviation",
        "95 % limits, any noise",
        "Model: GM + WN + QN + RW",
    )


def test_deep_tails_do_not_decide_the_axis_but_every_summit_is_seen(wv, fit):
    panel = fit_panel(fit)
    tails = min(part.min() for part in fit.decomposition.values())
    assert tails < 1e-3 * wv.variance.min()
    assert panel.y.limits[0] > wv.variance.min() / 15
    for line in panel.lines:
        assert np.any(line.y > panel.y.limits[0]), line.label


def test_a_term_below_the_axes_says_so(fit):
    tiny = {**fit.decomposition, "WN": fit.decomposition["WN"] * 1e-9}
    labels = fit_panel(replace(fit, decomposition=tiny)).labels
    assert next(label for label in labels if label.endswith("(below the axes)")).startswith("WN: ")


def test_a_term_that_is_zero_says_so(fit):
    none = {**fit.decomposition, "WN": np.zeros_like(fit.implied)}
    assert "WN: zero, not supported" in fit_panel(replace(fit, decomposition=none)).labels


def test_terms_that_are_zero_share_an_entry_without_a_curve(fit):
    none = {**fit.decomposition, "WN": np.zeros_like(fit.implied), "RW": np.zeros_like(fit.implied)}
    panel = fit_panel(replace(fit, decomposition=none))
    assert panel.labels[-1] == "WN, RW: zero, not supported"
    assert len(panel.labels) == 3 + len(none) - 1
    assert panel[panel.labels[-1]].stroke.width == 0


def test_what_acts_as_another_process_says_so(fit):
    acting = replace(fit, diagnostics=replace(fit.diagnostics, acts_as={"GM": "WN"}))
    assert any(label.endswith("(like WN)") for label in fit_panel(acting).labels)


def test_levels_left_out_are_open_symbols(fit):
    from gmwm.showing.plots.curves import observed_marks, view_for

    wv = fit.wavelet_variance
    used = wv.levels < 19
    marks = observed_marks(wv, view_for(wv, "wavelet", "si"), used=used)
    (rings,) = [mark for mark in marks if mark.label == "Left out of the fit"]
    assert not rings.stroke.filled
    np.testing.assert_array_equal(np.isfinite(rings.y), ~used)


def test_six_axes_in_a_grid_share_scales_by_row_and_label_them_once(six):
    figure = description(plot_imu)(six)
    assert [[panel.title for panel in row] for row in figure.rows] == [
        [f"{sensor} {letter}" for letter in "XYZ"] for sensor in ("Gyroscope", "Accelerometer")
    ]
    for row in figure.rows:
        assert len({panel.y.limits for panel in row}) == 1
        assert [bool(panel.y.label) for panel in row] == [True, False, False]
    assert [bool(row[0].x.label) for row in figure.rows] == [False, True]
    assert figure.labels == ("Allan deviation", "95 % limits, any noise")


def test_axes_of_different_length_share_the_scales_of_the_longest(six):
    signal = gmwm.Signal(np.random.default_rng(3).normal(size=4096), 100.0, "rad/s", "gyro_x")
    figure = description(plot_imu)(six | {"gyro_x": gmwm.wavelet_variance(signal)})
    assert len({panel.x.limits for panel in figure.panels}) == 1
    assert all(panel.x.opposite for panel in figure.rows[0])
    assert not any(panel.x.opposite for panel in figure.rows[1])


def looks(panel):
    """The stroke of every term of a panel; several terms that look alike share an entry."""
    lines = [line for line in panel.lines if line.layer == ABOVE and line.label]
    return {term: line.stroke for line in lines for term in line.label.split(":")[0].split(", ")}


def test_terms_look_alike_in_all_panels_and_alone(fit, wv):
    text = "RW(gamma2=1e-13) + GM(beta=5.0, sigma2=6e-9) + GM(beta=0.1, sigma2=6e-9) + WN(sigma2=7e-7)"
    twice = gmwm.Model.parse(text)
    other = replace(fit, model=twice, decomposition=twice.decomposition(wv.levels, wv.rate))
    figure = description(plot_imu)({"gyro_x": other, "gyro_y": fit})
    for panel, one in zip(figure.panels, (other, fit), strict=True):
        alone = looks(fit_panel(one))
        assert set(alone) == set(one.decomposition)
        assert alone.items() & looks(panel).items()
        assert set(looks(panel).values()) <= set(alone.values())
    # The first GM of one axis and the only one of the other look the same: one entry of the legend for both.
    assert "GM, GM[1]" in figure.labels
    assert not {"GM", "GM[1]"} & set(figure.labels)
    both = looks(figure.panels[0]), looks(figure.panels[1])
    assert set(both[0]) & set(both[1]) >= {"RW", "WN"}
    assert all(both[0][term] == both[1][term] for term in set(both[0]) & set(both[1]))


@pytest.mark.parametrize("text", ["3*GM + WN", "WN + QN + RW + DR + 5*GM", "3*GM + WN + QN + FN + RW + 2*SIN"])
def test_up_to_nine_terms_differ_in_colour_and_dash(text):
    model = gmwm.Model.parse(text)
    strokes = term_strokes(model.terms, model.processes).values()
    assert len({stroke.colour for stroke in strokes}) == len({stroke.dash for stroke in strokes}) == len(model.terms)


@pytest.mark.parametrize("text", ["WN + QN + RW + DR + 5*GM", "DR + 5*AR1 + WN", "12*GM + WN + RW"])
def test_no_two_terms_of_a_model_look_alike(text):
    model = gmwm.Model.parse(text)
    strokes = list(term_strokes(model.terms, model.processes).values())
    for one, other in combinations(strokes, 2):
        assert one.dash != other.dash or len(strokes) > 9
        assert one != other


PLACES = {"WN": 0, "QN": 1, "RW": 2, "DR": 3, "GM": 4, "AR1": 4}


def test_strokes_of_inertial_noise_do_not_move_when_processes_are_added():
    for name, place in PLACES.items():
        process = registry[name]()
        assert term_strokes([name], [process]) == {name: term_stroke(place)}


class Named:
    """As much of a process as its stroke goes by."""

    def __init__(self, name, parametrises=None):
        self.name, self.parametrises = name, parametrises


def test_every_process_has_a_stroke_that_goes_by_its_name():
    others = [process() for name, process in registry.items() if name not in PLACES]
    others += [Named(name) for name in ("SARMA(1,0,1,1,12)", "New")]
    core = gmwm.Model.parse("WN + QN + RW + DR + 2*GM")
    for process in others:
        alone = term_strokes([process.name], [process])[process.name]
        terms = [*core.terms, process.name]
        together = term_strokes(terms, [*core.processes, process])
        assert together[process.name] == alone
        assert len({stroke.dash for stroke in together.values()}) == 7
        assert len({stroke.colour for stroke in together.values()}) == 7
    assert term_strokes(["SARMA"], others[-2:-1]).values() != term_strokes(["New"], others[-1:]).values()


@pytest.mark.parametrize("name", ["ARMA(2,1)", "AR(3)", "MA(1)"])
def test_filtered_white_noise_has_the_stroke_of_white_noise_which_it_replaces(name):
    core = gmwm.Model.parse("QN + FN + RW + 2*GM")
    together = term_strokes([*core.terms, name], [*core.processes, Named(name)])
    assert together[name] == term_stroke(PLACES["WN"])
    white = gmwm.Model.parse("WN")
    both = term_strokes(["WN", name], [*white.processes, Named(name)])
    assert both["WN"] == term_stroke(PLACES["WN"]) != both[name]


@pytest.mark.slow
def test_lines_beyond_two_share_one_curve_of_their_sum():
    model = gmwm.Model.parse("WN(1) + SIN(1, 0.1) + SIN(2, 0.2) + SIN(3, 0.3)")
    fit = gmwm.fit(model.structure, model.simulate(4096, 10.0, rng=1), rate=10.0)
    panel = fit_panel(fit, view="wavelet")
    (line,) = (mark for mark in panel.marks if mark.label == "3 lines")
    assert np.allclose(line.y, sum(fit.decomposition[f"SIN[{k}]"] for k in (1, 2, 3)))
    assert not any(mark.label.startswith("SIN") for mark in panel.marks)


@pytest.mark.parametrize("count", [2, 5, 9, 12])
def test_many_new_processes_in_one_model_are_told_apart(count):
    terms = [f"SIN[{k}]" for k in range(1, count + 1)]
    strokes = term_strokes(["WN", *terms], [registry["WN"](), *[Named("SIN")] * count])
    assert len(set(strokes.values())) == count + 1
    assert len({stroke.dash for stroke in strokes.values()}) == min(count + 1, 9)
    turned = term_strokes([*terms, "WN"], [*[Named("SIN")] * count, registry["WN"]()])
    assert turned == strokes


def test_strokes_of_terms_repeat_late():
    assert len({term_stroke(k) for k in range(108)}) == 108


def test_terms_lie_over_the_model_and_under_the_data(fit):
    panel = fit_panel(fit)
    layers = {line.label.split(":")[0]: line.layer for line in panel.lines}
    terms = [layers[term] for term in fit.decomposition]
    assert layers["Model"] < min(terms) <= max(terms) < layers["Allan deviation"]


def test_a_term_that_is_zero_says_so_in_a_grid_too(fit):
    none = replace(fit, decomposition={**fit.decomposition, "QN": np.zeros_like(fit.implied)})
    full, bare = description(plot_imu)({"gyro_x": fit, "gyro_y": none}).panels
    assert (full.texts, [text.text for text in bare.texts]) == ((), ["QN: zero"])
    assert full.y.limits == bare.y.limits


def test_limits_of_several_curves_have_a_neutral_swatch(wv, six):
    assert {band.swatch for panel in description(plot_imu)(six, split=False).panels for band in panel.bands} == {GREY}
    assert {band.swatch for band in overlay_panel({"alone": wv}).bands} == {""}


@pytest.mark.parametrize("split", [True, False])
@pytest.mark.parametrize("names", [["gyro_y"], ["gyro_x", "gyro_z", "accel_z"], ["a", "b", "c", "d"]])
def test_fewer_axes_and_other_names(wv, split, names, scaled):
    figure = description(plot_imu)({name: scaled(wv, axis=name) for name in names}, split=split)
    assert sum(len(panel.bands) for panel in figure.panels) == len(names)
    assert len({len(row) for row in figure.rows}) == 1
    lowest = [[row[k] for row in figure.rows if row[k] is not None][-1] for k in range(len(figure.rows[0]))]
    assert all(panel.x.label and panel.x.ticks[0].label for panel in lowest)


def test_sensors_over_one_another(fit, six):
    figure = description(plot_imu)(six, split=False)
    assert [panel.title for panel in figure.panels] == ["Gyroscope", "Accelerometer"]
    assert figure.labels == ("X", "Y", "Z", "95 % limits, any noise")
    model = description(plot_imu)({"gyro_y": fit}, split=False, view="wavelet").panels[0]["Y, model"]
    np.testing.assert_array_equal(model.y, fit.implied)


def test_curves_of_two_units_are_not_compared(wv, scaled):
    with raises(OptionError, "a in deg/h", "b in mg", argument="items", got=("deg/h", "mg")):
        overlay_panel({"a": wv, "b": scaled(wv, unit="m/s²")})


def test_curves_of_one_quantity_meet_in_one_unit(wv, scaled):
    half = scaled(wv, variance=wv.variance * (180 / np.pi) ** 2, unit="deg/s")
    panel = overlay_panel({"rad": wv, "deg": half})
    np.testing.assert_allclose(panel["rad"].y, panel["deg"].y, rtol=1e-12)


@pytest.mark.parametrize("items", [{}, [1, 2], {"gyro_x": np.ones(4)}])
def test_foreign_things_are_refused(items):
    with raises(OptionError, "WaveletVariance or Fit", argument="items"):
        description(plot_imu)(items)


@pytest.mark.parametrize(
    "strokes",
    [
        [term_stroke(k) for k in range(9)],
        [letter_stroke(letter) for letter in "xyz"],
        [curve_stroke(k) for k in range(6)],
    ],
)
def test_no_two_strokes_differ_by_colour_alone(strokes):
    for one, other in combinations(strokes, 2):
        assert (one.dash, one.symbol) != (other.dash, other.symbol)


def test_a_robust_estimate_has_a_symbol_of_its_own(wv):
    marks = {
        robust: wavelet_variance_panel(replace(wv, robust=robust, efficiency=0.6 if robust else None)).lines[0]
        for robust in (False, True)
    }
    assert {robust: line.stroke.symbol for robust, line in marks.items()} == {False: "circle", True: "diamond"}
