import itertools
import pickle

import numpy as np
import pytest

from gmwm.base.errors import MissingTheoryError, ModelError, OptionError
from gmwm.theory.processes import AR1, DR, GM, QN, RW, WN, Model, as_model, fixed
from tests.helpers import raises

RATE = 100.0
FULL = Model.parse(
    "GM(beta=0.3, sigma2=2) + GM(beta=20, sigma2=5) + WN(sigma2=4) + QN(q2=3) + RW(gamma2=0.01) + DR(omega=-0.002)"
)


def test_a_sum_is_flat_and_associative():
    a, b, c = GM(), WN(), RW()
    assert ((a + b) + c).processes == (a + (b + c)).processes == (a, b, c)
    assert (2 * a + b).processes == (a, a, b)
    assert (a * 2) == 2 * a == a + a
    assert 2 * (GM() + GM(beta=1.0)) == GM() + GM(beta=1.0) + GM() + GM(beta=1.0)


def test_labels_count_from_one_where_a_process_is_repeated():
    model = WN() + GM() + RW() + GM()
    assert model.terms == ("WN", "GM[1]", "RW", "GM[2]")
    assert model.names == ("WN.sigma2", "GM[1].beta", "GM[1].sigma2", "RW.gamma2", "GM[2].beta", "GM[2].sigma2")
    assert list(model.parameters) == list(model.names)
    assert model.structure == "WN + GM + RW + GM"


@pytest.mark.parametrize(
    ("build", "expected"),
    [
        (lambda: 2 * WN(), {"facts": ("WN", "2 times"), "advises": ("`WN()` once",)}),
        (lambda: QN() + WN() + QN(), {"facts": ("QN", "2 times"), "advises": ("`QN()` once",)}),
        (lambda: GM() + AR1(), {"facts": ("GM", "AR1"), "advises": ("as GM", "as AR1")}),
        (lambda: 2 * GM(beta=fixed(1.0)), {"facts": ("GM", "beta=fixed(1.0)"), "advises": ("different values",)}),
        (lambda: 0 * GM(), {"facts": ("1 to 100", "got 0"), "got": 0}),
        (lambda: 2.5 * GM(), {"facts": ("1 to 100",), "got": 2.5}),
        (lambda: True * GM(), {"facts": ("1 to 100", "got True"), "got": True}),
        (lambda: 101 * GM(), {"facts": ("1 to 100",), "got": 101}),
        (lambda: 60 * GM() + 60 * GM(), {"facts": ("100",), "got": 120}),
        (lambda: GM() + WN, {"argument": "processes", "got": WN, "advises": ("WN()",)}),
        (lambda: Model(()), {"facts": ("one",), "got": ()}),
        (lambda: Model(("WN",)), {"argument": "processes", "got": "WN", "advice": ""}),
        (lambda: Model((int,)), {"argument": "processes", "got": int, "advice": ""}),
        (lambda: as_model(3), {"argument": "model", "got": 3, "advice": ""}),
        (lambda: as_model(GM), {"argument": "model", "got": GM, "advises": ("GM()",)}),
    ],
)
def test_what_cannot_be_a_model_is_an_error_that_says_what_to_do(build, expected):
    facts = expected.get("facts", ())
    with raises(ModelError, *facts, **{name: value for name, value in expected.items() if name != "facts"}):
        build()


def test_a_sum_with_something_else_is_a_type_error():
    with pytest.raises(TypeError):
        GM() + 3


def test_held_scales_make_equal_shapes_legal():
    assert len((2 * GM(beta=fixed(1.0), sigma2=fixed(2.0))).processes) == 2


def test_values_are_replaced_by_label_and_stay_held():
    model = GM() + GM(beta=fixed(1.0)) + WN(sigma2=2.0)
    changed = model.with_values({"GM[1].beta": 0.5, "GM[2].beta": 3.0, "WN.sigma2": None})
    assert changed == GM(beta=0.5) + GM(beta=fixed(3.0)) + WN()
    assert changed.fixed_names == {"GM[2].beta"}
    assert model.parameters["GM[2].beta"] == 1.0
    assert not changed.is_complete
    assert FULL.is_complete
    assert model.with_values({"GM[2].beta": None}) == GM() + GM() + WN(sigma2=2.0)
    with raises(ModelError, "GM[1].beta, GM[1].sigma2, GM[2].beta, GM[2].sigma2, WN.sigma2", got="GM.beta"):
        model.with_values({"GM.beta": 1.0})
    with raises(ModelError, "GM", "beta, sigma2", argument="alpha"):
        GM().with_values(alpha=1.0)


def test_repeated_terms_are_sorted_by_correlation_time_in_their_places():
    model = GM(beta=0.1) + WN() + GM() + GM(beta=5.0)
    assert model.sorted(RATE).processes == (GM(beta=5.0), WN(), GM(beta=0.1), GM())
    three = AR1(phi=0.9) + AR1(phi=-0.1) + AR1(phi=0.0)
    assert three.sorted(RATE).processes == (AR1(phi=0.0), AR1(phi=-0.1), AR1(phi=0.9))


def test_missing_values_are_named():
    with raises(ModelError, "wavelet variance", "GM + WN", missing=("GM.beta", "GM.sigma2", "WN.sigma2")):
        (GM() + WN()).wavelet_variance(3, RATE)
    with raises(ModelError, argument="GM.beta"):
        GM(sigma2=1.0).wavelet_variance(3, RATE)


def test_the_decomposition_adds_up_and_order_does_not_matter():
    parts = FULL.decomposition(15, RATE)
    assert tuple(parts) == FULL.terms
    total = FULL.wavelet_variance(15, RATE)
    np.testing.assert_allclose(sum(parts.values()), total, rtol=1e-15)
    for processes in itertools.islice(itertools.permutations(FULL.processes), 0, 720, 97):
        np.testing.assert_allclose(Model(processes).wavelet_variance(15, RATE), total, rtol=1e-14)


def test_the_jacobian_is_the_derivative_by_each_named_parameter():
    model = FULL + GM(beta=300.0, sigma2=0.5)
    jacobian = model.jacobian([1, 2, 5, 9, 14], RATE)
    assert jacobian.shape == (5, len(model.names))
    for column, name in zip(jacobian.T, model.names, strict=True):
        value = model.parameters[name]
        step = 1e-4 * value
        above, below = (
            model.with_values({name: value + s * step}).wavelet_variance([1, 2, 5, 9, 14], RATE) for s in (1, -1)
        )
        term = model.decomposition([1, 2, 5, 9, 14], RATE)[name.split(".")[0]]
        assert np.all(
            np.abs(column - (above - below) / (2 * step)) <= 1e-6 * np.abs(term / value) + 1e-11 * above / abs(step)
        )


def test_the_jacobian_by_a_scale_at_zero_is_the_shape():
    model = WN(sigma2=0.0) + DR(omega=0.0) + GM(beta=1.0, sigma2=0.0)
    jacobian = model.jacobian(4, RATE)
    np.testing.assert_array_equal(jacobian[:, 0], WN.shape(np.empty((1, 0)), 4, RATE)[0])
    np.testing.assert_array_equal(jacobian[:, 1], 0.0)  # the wavelet variance is flat in ω at 0
    np.testing.assert_array_equal(jacobian[:, 2], 0.0)
    np.testing.assert_array_equal(model.wavelet_variance(4, RATE), 0.0)


def test_theory_of_a_sum_is_the_sum_and_says_what_is_missing():
    stationary = Model(FULL.processes[:4])
    np.testing.assert_allclose(
        stationary.autocovariance([0, 1, -1], RATE), stationary.state_space(RATE).autocovariance([0, 1, -1])
    )
    f = np.linspace(-50, 50, 7)
    np.testing.assert_allclose(stationary.psd(f, RATE), stationary.state_space(RATE).psd(f, RATE), rtol=1e-10)
    np.testing.assert_allclose(FULL.state_space(RATE).haar_variance(16), FULL.wavelet_variance(16, RATE), rtol=1e-9)
    np.testing.assert_allclose(FULL.mean([0, 10]), [0.0, -0.02])
    assert FULL.has("state_space")
    assert not FULL.has("running_sum_covariance")
    rest = " + ".join(str(process) for process in FULL.processes if process.name != "DR")
    with raises(MissingTheoryError, process="DR", theory="running_sum_covariance", rest=rest):
        FULL.running_sum_covariance([0, 1], RATE)
    with raises(MissingTheoryError, "not stationary", process="RW", theory="autocovariance"):
        FULL.autocovariance([0], RATE)
    with raises(OptionError, argument="lags", got=[0.5]):
        stationary.autocovariance([0.5], RATE)
    with raises(OptionError, "±50 Hz", argument="frequencies"):
        stationary.psd([60.0], RATE)


def test_simulation_is_reproducible_and_adds_up_in_any_order():
    paths = FULL.simulate(500, RATE, 3, paths=2)
    assert paths.shape == (2, 500)
    terms = FULL.simulate_terms(500, RATE, np.random.default_rng(3), paths=2)
    assert tuple(terms) == FULL.terms
    np.testing.assert_allclose(sum(terms.values()), paths, rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(Model(FULL.processes[::-1]).simulate(500, RATE, 3, paths=2), paths)
    assert FULL.simulate(5, RATE, 3).shape == (5,)
    assert not np.array_equal(FULL.simulate(500, RATE, 4, paths=2), paths)


def test_a_process_alone_and_a_text_stand_for_a_model():
    assert as_model(WN()) == as_model("WN") == as_model(Model((WN(),)))


def test_models_are_values():
    assert pickle.loads(pickle.dumps(FULL)) == FULL
    assert hash(FULL) == hash(Model(FULL.processes))
    assert repr(FULL).startswith("Model('GM(beta=0.3, sigma2=2.0) + ")


def test_equality_ignores_the_order_of_terms_and_nothing_else():
    one, other = Model.parse("WN + 2*GM"), Model.parse("2*GM + WN")
    assert one == other
    assert hash(one) == hash(other)
    assert len({one, other}) == 1
    assert (str(one), str(other)) == ("WN + 2*GM", "2*GM + WN")
    for order in itertools.permutations(FULL.processes):
        assert Model(order) == FULL
        assert hash(Model(order)) == hash(FULL)
    for different in ("GM + WN", "3*GM + WN", "2*GM + QN", "2*GM + WN(sigma2=1)", "GM + GM(beta=fixed(1)) + WN"):
        assert Model.parse(different) != one
    assert one != "WN + 2*GM"
    assert Model((WN(),)) != WN()


def test_units_of_parameters():
    assert (GM() + DR() + WN()).units("m/s²") == {
        "GM.beta": "1/s", "GM.sigma2": "(m/s²)²", "DR.omega": "m/s² per sample", "WN.sigma2": "(m/s²)²",
    }  # fmt: skip
    assert AR1().parameters[0].unit("rad/s") == ""
    assert WN().parameters[0].unit("g") == "g²"


def test_sum_adds_processes_and_models():
    assert sum([GM(), WN()]) == GM() + WN()
    assert sum([WN()]) == Model((WN(),))
    assert sum([WN() + GM(), RW()]) == WN() + GM() + RW()
    for other in (1, 0.5, "WN"):
        with pytest.raises(TypeError):
            other + WN()
        with pytest.raises(TypeError):
            other + (WN() + GM())
