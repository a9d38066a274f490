"""One form of model for the axes of a sensor: which forms are shared, and which are not."""

from dataclasses import replace

import pytest

import gmwm
from gmwm.choosing.selection.ranking import RankingOptions
from gmwm.choosing.selection.search import within_family
from gmwm.choosing.selection.shared_form import with_shared_form
from gmwm.choosing.selection.structure import slow_terms

TRUTH = "GM(beta=1.0, sigma2=1e-6) + WN(sigma2=4e-6) + RW(gamma2=1e-9)"
SMALL, OTHER, LARGE = "WN + RW", "GM + WN", "GM + WN + RW"


@pytest.fixture(scope="module")
def choice():
    wv = gmwm.wavelet_variance(gmwm.simulate_signal(TRUTH, rate=10.0, samples=20_000, rng=1).signal)
    return within_family("GM + WN + RW", wv, RankingOptions())


def having(choice, differences, *, recommended, equivalent=(), pvalues=(), ratio=1.0):
    """Return the choice with the candidates in `differences`; the fit of the largest one is `ratio` times the data."""
    candidates = []
    for model, difference in sorted(differences.items(), key=lambda pair: pair[1]):
        candidate = choice.ranking[model]
        fit = candidate.fit
        fit = fit if model != LARGE else replace(fit, implied=ratio * fit.wavelet_variance.variance)
        candidate = replace(
            candidate, fit=fit, difference=difference, recommended=model == recommended,
            equivalent=model in (recommended, *equivalent), same_as=None,
        )  # fmt: skip
        candidate.__dict__["pvalue"] = dict(pvalues).get(model, 0.5)
        candidates.append(candidate)
    return replace(choice, ranking=replace(choice.ranking, candidates=tuple(candidates)))


def forms_of(choices):
    return {axis: slow_terms(choice.ranking.recommended.model) for axis, choice in choices.items()}


def three(choice, **of_z):
    """Two axes that recommend the large model, and one that recommends the small one."""
    large = having(choice, {LARGE: 0.0, SMALL: 9.0}, recommended=LARGE)
    small = having(choice, {LARGE: 0.0, SMALL: 3.0}, recommended=SMALL, **of_z)
    return {"gyro_x": large, "gyro_y": large, "gyro_z": small}


def test_axes_share_a_form_that_does_not_increase_their_criteria(choice):
    before = three(choice)
    after = with_shared_form(before)
    assert set(forms_of(after).values()) == {("GM", "RW")}
    assert after["gyro_x"] is before["gyro_x"]
    ranking, steps = after["gyro_z"].ranking, after["gyro_z"].steps
    assert [c.structure for c in ranking.equivalent] == [LARGE, SMALL]
    assert [c.structure for c in ranking if c.recommended] == [LARGE]
    assert [(step.entered, step.left, step.used) for step in steps[-2:]] == [
        ("within", "accepted", False), ("sensor", "shared", True)
    ]  # fmt: skip
    assert steps[-1].recommended == LARGE
    assert LARGE in steps[-1].text()


@pytest.mark.parametrize(("increase", "decrease", "shared"), [(0.6, 5.0, True), (1.6, 5.0, False), (0.6, 0.5, False)])
def test_no_axis_gets_a_parameter_that_it_does_not_need(choice, increase, decrease, shared):
    small = having(choice, {SMALL: 0.0, LARGE: increase}, recommended=SMALL)
    other = having(choice, {LARGE: 0.0, OTHER: decrease}, recommended=OTHER)
    large = having(choice, {LARGE: 0.0}, recommended=LARGE)
    after = with_shared_form({"gyro_x": small, "gyro_y": other, "gyro_z": large})
    assert (len(set(forms_of(after).values())) == 1) is shared


def test_a_stationary_model_does_not_replace_one_with_a_walk(choice):
    walk = having(choice, {OTHER: 0.0, SMALL: 3.0}, recommended=SMALL)
    markov = having(choice, {OTHER: 0.0}, recommended=OTHER)
    before = {"gyro_x": walk, "gyro_y": markov, "gyro_z": markov}
    assert with_shared_form(before) == before


@pytest.mark.parametrize(("model", "shared"), [(SMALL, True), ("WN", False)])
def test_an_axis_gets_at_most_one_term(choice, model, shared):
    small = having(choice, {LARGE: 0.0, model: 3.0}, recommended=model)
    large = having(choice, {LARGE: 0.0}, recommended=LARGE)
    after = with_shared_form({"gyro_x": small, "gyro_y": large, "gyro_z": large})
    assert (len(set(forms_of(after).values())) == 1) is shared


def test_a_rejected_model_is_not_shared(choice):
    before = three(choice, pvalues={LARGE: 0.004})
    assert with_shared_form(before) == before
    assert with_shared_form(three(choice, pvalues={LARGE: 0.006})) != before
    # If the test rejects all models, the better one may be shared.
    both = three(choice, pvalues={LARGE: 0.004, SMALL: 0.001})
    assert forms_of(with_shared_form(both))["gyro_z"] == ("GM", "RW")


@pytest.mark.parametrize(("ratio", "shared"), [(0.25, True), (4.0, True), (8.0, False), (0.1, False)])
def test_a_model_that_misses_a_level_by_far_is_not_shared(choice, ratio, shared):
    after = with_shared_form(three(choice, ratio=ratio))
    assert (forms_of(after)["gyro_z"] == ("GM", "RW")) is shared


def test_an_axis_that_does_not_accept_the_form_keeps_its_model(choice):
    lone = having(choice, {OTHER: 0.0}, recommended=OTHER)
    small = having(choice, {LARGE: 0.0, SMALL: 2.0}, recommended=SMALL)
    large = having(choice, {LARGE: 0.0}, recommended=LARGE)
    after = with_shared_form({"gyro_x": large, "gyro_y": small, "gyro_z": lone})
    assert forms_of(after) == {"gyro_x": ("GM", "RW"), "gyro_y": ("GM", "RW"), "gyro_z": ("GM",)}
    # One of two axes is not most of them.
    pair = {"gyro_x": large, "gyro_z": lone}
    assert with_shared_form(pair) == pair


def test_other_sensors_and_names_without_a_sensor_are_independent(choice):
    x, _, z = three(choice).values()
    for names in (("gyro_x", "gyro_y", "accel_x"), ("a", "b", "c")):
        before = dict(zip(names, (x, x, z), strict=True))
        assert with_shared_form(before) == before
