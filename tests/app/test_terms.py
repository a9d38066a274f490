"""Changes of a model in the page."""

import numpy as np
import pytest

import gmwm
from gmwm.applications.app.figures import axis_at, fit_figure, movable
from gmwm.applications.app.page.model import adding, held_at, holding, removing, replacing
from gmwm.applications.app.session import Session
from gmwm.base.errors import OptionError
from tests.helpers import raises


@pytest.fixture(scope="module")
def fit():
    truth = "WN(sigma2=4e-7) + GM(beta=0.5, sigma2=4e-8)"
    signal = gmwm.simulate({"gyro_x": truth}, rate=100.0, samples=100_000, rng=1)["gyro_x"]
    return gmwm.fit("WN + GM", signal)


def test_terms_come_and_go(fit):
    assert adding("GM + WN", "GM") == "2*GM + WN"
    assert removing(fit, "WN") == "GM"
    with raises(OptionError, argument="model"):
        removing(gmwm.fit("WN", fit.wavelet_variance), "WN")


def test_a_parameter_is_held_at_its_estimate_and_freed_again(fit):
    held = gmwm.fit(holding(fit, "GM.beta"), fit.wavelet_variance)
    assert held.model.fixed_names == {"GM.beta"}
    assert held.parameters["GM.beta"] == fit.parameters["GM.beta"]
    assert held.objective == pytest.approx(fit.objective, rel=1e-6)
    assert gmwm.Model.parse(holding(held, "GM.beta")).fixed_names == frozenset()
    at = gmwm.Model.parse(held_at(fit, "WN.sigma2", "1e-6"))
    assert (at.parameters["WN.sigma2"], at.fixed_names) == (1e-6, {"WN.sigma2"})
    with raises(OptionError, got="much"):
        held_at(fit, "WN.sigma2", "much")


@pytest.mark.parametrize("view", ["allan", "wavelet"])
@pytest.mark.parametrize("units", ["si", "datasheet"])
def test_a_dragged_term_goes_through_its_new_place(fit, view, units):
    session = Session(view=view, units=units)
    shapes = fit_figure(fit, session, 800)["layout"]["shapes"]
    places = {t: (shape["xanchor"], shape["yanchor"]) for t, shape in zip(movable(fit), shapes, strict=True)}
    assert set(places) == {"GM", "WN"}
    for term, (x, y) in places.items():
        same = axis_at(fit, term, (x, y), session)
        old = dict(zip(fit.model.terms, fit.model.processes, strict=True))[term]
        for name, value in old.values.items():
            assert same.value(name) == pytest.approx(value, rel=1e-9)
            assert same.is_fixed(name)
        # Twice the height: four times the variance of a deviation, twice that of a variance.
        ratio = axis_at(fit, term, (x, 2 * y), session).scale / old.scale
        assert ratio == pytest.approx(4.0 if view == "allan" else 2.0, rel=1e-9)
    x, y = places["GM"]
    earlier = axis_at(fit, "GM", (x / 4, y), session)
    assert earlier.value("beta") == pytest.approx(4 * fit.parameters["GM.beta"], rel=1e-9)
    wv = fit.wavelet_variance
    level = int(np.argmax(fit.decomposition["GM"] / fit.implied))
    old = fit.decomposition["GM"][level]
    assert earlier.wavelet_variance(wv.levels, wv.rate)[level - 2] == pytest.approx(old, rel=1e-9)


def test_a_dragged_term_is_held(fit):
    session = Session()
    process = axis_at(fit, "WN", (0.1, 20.0), session)
    model = gmwm.Model.parse(replacing(fit, "WN", process))
    assert model.fixed_names == {"WN.sigma2"}
    assert set(model.terms) == {"WN", "GM"}
