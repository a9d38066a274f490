import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gmwm.base.errors import ModelError
from gmwm.theory.processes import AR, AR1, ARMA, DR, GM, MA, QN, RW, SARMA, WN, Model, fixed, registry
from tests.helpers import each, raises

profile = settings(derandomize=True, deadline=None, max_examples=150, database=None)
FINITE = {
    "positive": st.floats(min_value=5e-324, allow_infinity=False),
    "real": st.floats(allow_nan=False, allow_infinity=False),
    "between": st.floats(-1, 1, exclude_min=True, exclude_max=True),
}


@st.composite
def processes(draw):
    process = draw(st.sampled_from(list(registry.values())))
    values = {}
    for parameter in process.parameters:
        number = FINITE[parameter.domain]
        if parameter.limits != (-1.0, 1.0):
            number = st.floats(*parameter.limits, exclude_min=True, exclude_max=True)
        value = draw(st.none() | number | number.map(fixed))
        if value is not None:
            values[parameter.name] = value
    return process(**values)


@st.composite
def models(draw):
    chosen, kept = draw(st.lists(processes(), min_size=1, max_size=5)), []
    for process in chosen:
        try:
            Model((*kept, process))
        except ModelError:  # a repeat that is not allowed: leave it out
            continue
        kept.append(process)
        if process.repeatable and not any(process.is_fixed(p.name) for p in process.parameters):
            kept += [process] * draw(st.integers(0, 3))
    return Model(tuple(kept))


@pytest.mark.slow
@profile
@given(models())
def test_text_and_model_are_the_same_thing_both_ways(model):
    again = Model.parse(str(model))
    assert again == model
    assert str(again) == str(model)
    # Equality takes -0.0 for 0.0; the text does not.
    assert repr(again.parameters) == repr(model.parameters)


@pytest.mark.parametrize("process", registry.values(), ids=registry)
def test_values_without_names_are_the_parameters_in_their_order(process):
    inside = {"positive": 0.5, "real": -2.5, "between": 0.25}
    given = {
        p.name: inside[p.domain] if p.limits == (-1.0, 1.0) else sum(p.limits) / 2 + 0.01 for p in process.parameters
    }
    text = f"{process.name}({', '.join(map(str, given.values()))})"
    assert Model.parse(text) == Model((process(**given),))


@pytest.mark.slow
@profile
@given(models())
def test_the_representation_of_a_process_is_python(model):
    names = {**registry, "fixed": fixed}
    for process in model.processes:
        assert eval(repr(process), {"__builtins__": {}}, names) == process


@pytest.mark.slow
@profile
@given(st.text(alphabet="GMWNQRDA13*+-()=,. efixdbtasgm2_\n\"'[]é", max_size=40) | st.text(max_size=20))
def test_any_text_is_a_model_or_a_model_error(text):
    try:
        model = Model.parse(text)
    except ModelError:
        return
    assert Model.parse(str(model)) == model


@each(
    ("text", "model"),
    [
        ("3*GM + WN + QN + RW", 3 * GM() + WN() + QN() + RW()),
        ("gm*2+wn()", 2 * GM() + WN()),
        (" GM ( beta = 0.01 , sigma2 = fixed( +1e-6 ) )\n+ WN ", GM(beta=0.01, sigma2=fixed(1e-6)) + WN()),
        ("GM(sigma2=.5)", Model((GM(sigma2=0.5),))),
        ("WN(sigma2=0)", Model((WN(sigma2=0.0),))),
        ("AR(2) + WN", AR(2) + WN()),
        ("3*gm + ma( 1 )+RW", 3 * GM() + MA(1) + RW()),
        ("ARMA(2,1)", Model((ARMA(2, 1),))),
        ("ARMA(2, 1, phi1=1.4, phi2=-.6, theta1=fixed(0.3))", Model((ARMA(phi=[1.4, -0.6], theta=[fixed(0.3)]),))),
        ("SARMA(1, 0, 1, 0, 12)", Model((SARMA(1, 0, 1, 0, period=12),))),
        ("AR1(0.9, 0.1) + WN(4)", AR1(phi=0.9, sigma2=0.1) + WN(sigma2=4.0)),
        ("GM(fixed(0.5), sigma2=2)", Model((GM(beta=fixed(0.5), sigma2=2.0),))),
        ("GM(0.5)", Model((GM(beta=0.5),))),
        ("DR(-0.5)", Model((DR(omega=-0.5),))),
        ("AR(2, 1.4, -0.6, 1)", Model((AR(phi=[1.4, -0.6], sigma2=1.0),))),
        ("AR(2, 0.5)", Model((AR(2, phi1=0.5),))),
        ("ARMA(1, 1, fixed(0.5), theta1=0.2)", Model((ARMA(1, 1, phi1=fixed(0.5), theta1=0.2),))),
        ("SARMA(1, 0, 1, 0, period=12, 0.3, sphi1=0.5)", Model((SARMA(1, 0, 1, 0, 12, phi1=0.3, sphi1=0.5),))),
        ("SARMA(1, 0, 1, 0, period=12, sphi1=0.5)", Model((SARMA(1, 0, 1, 0, 12, sphi1=0.5),))),
    ],
)
def test_texts_that_are_models(text, model):
    assert Model.parse(text) == Model.parse(text) == model


@each(
    ("text", "character", "facts"),
    [
        ("GM + XX", 6, ('"XX"', "WN, QN, RW, DR, AR1, GM")),
        ("", None, ("the end", "a process, one of WN")),
        ("GM +", None, ("the end", "expected a process")),
        ("GM WN", 4, ('"WN"', 'expected "+" or the end')),
        ("3 GM", 3, ('expected "*"', "3*GM")),
        ("2.5*GM", 1, ('"2.5"', "a count from 1 to 100")),
        ("0*GM", 1, ("expected a count",)),
        ("99999999999999*GM", 1, ("expected a count",)),
        ("GM*x", 4, ('"x"', "expected a count")),
        ("GM([0.01])", 4, ("a parameter by name", "GM(beta=…)")),
        ("GM(beta=0.1, 0.2)", 14, ('"0.2"', "without a name")),
        ("GM(0.1, 0.2, 0.3)", 14, ('"0.3"', "too many values", "beta, sigma2")),
        ("GM(0.1, beta=0.2)", 9, ('"beta"', "given twice")),
        ("GM(0.1, -1)", 9, ('"-"', "GM.sigma2")),
        ("GM(alpha=1)", 4, ('"alpha"', "GM", "beta, sigma2")),
        ("GM(beta=1, beta=2)", 12, ("given twice",)),
        ("GM(beta 1)", 9, ('expected "=" after beta',)),
        ("GM(beta=1 sigma2=1)", 11, ('expected "," between parameters',)),
        ("GM(beta=-1)", 9, ('"-"', "GM.beta", "positive (1/s)", "got -1.0")),
        ("GM(beta=inf)", 9, ('"inf"', "a finite number")),
        ("GM(beta=1e999)", 9, ('"1e999"', "a finite number")),
        ("GM(beta=fixed 1)", 15, ('expected "(" after fixed',)),
        ("GM(beta=fixed(1)", None, ("at the end",)),
        ("GM - WN", 4, ('"-"', 'expected "+"')),
        ("GM; import os", 3, ('";"', "cannot contain")),
        ("__import__('os')", 12, ("cannot contain",)),
        ("__import__(os)", 1, ('"__import__"', "no process of this name")),
        ("GM + XX", 6, ("AR(p), MA(q), ARMA(p, q), SARMA(p, q, P, Q, period)",)),
        ("WN + AR", 6, ('"AR"', "AR(p)", "orders")),
        ("AR()", 1, ('"AR"', "orders")),
        ("AR(2", None, ('at the end: expected "," between orders and parameters',)),
        ("AR(2, 3)", 7, ('"3"', "phi1", "between -2 and 2", "got 3")),
        ("ARMA(2)", 1, ('"ARMA"', "got 1 orders")),
        ("AR(2.5)", 4, ('"2.5"', "an order, a whole number")),
        ("AR(99999999999)", 1, ("reaches back",)),
        ("AR(2 phi1=1)", 6, ('"phi1"', 'expected ","')),
        ("ARMA(2, 0.5)", 9, ('"0.5"', "expected an order")),
        ("AR(2, phi1=0.5, 1)", 17, ("without a name", "write phi1=…")),
        ("AR(1, phi2=0.5)", 7, ('"phi2"', "AR(1)", "phi1, sigma2")),
        ("WN + AR(1, phi1=1.5)", 17, ('"1.5"', "AR(1).phi1", "between -1 and 1", "got 1.5")),
        ("WN + AR(2, phi1=1.5, phi2=0.2)", 6, ('"AR"', "AR(2) must be stationary")),
        ("SARMA(1, 0, 1, 0, period 12)", 26, ('expected "=" after period',)),
    ],
)
def test_an_error_points_at_the_piece(text, character, facts):
    with raises(ModelError, *facts, character=character):
        Model.parse(text)


@pytest.mark.parametrize(
    ("text", "facts"),
    [
        ("+".join(["GM"] * 5000), ("10000 characters", "14999")),
        ("+".join(["GM"] * 200), ("at most 100 terms",)),
        ("100*GM + 100*GM", ("at most 100 terms", "200")),
    ],
)
def test_a_text_of_a_sum_that_is_no_model(text, facts):
    with raises(ModelError, *facts):
        Model.parse(text)


@pytest.mark.parametrize(
    ("text", "name", "instead", "count"),
    [
        ("WN + WN", "WN", "WN()", 2),
        ("2*AR(2)", "AR(2)", "ARMA(4,2)", 2),
        ("3*MA(2)", "MA(2)", "MA(2)", 3),
        ("2*SARMA(1,0,1,0,12)", "SARMA(1,0,1,0,12)", "SARMA(1,0,1,0,12)", 2),
    ],
)
def test_a_repeated_term_is_replaced_by_one_term(text, name, instead, count):
    with raises(ModelError, name, count, argument="processes", got=name, instead=instead):
        Model.parse(text)


def test_only_a_string_is_parsed():
    with raises(ModelError, "a string", got=3):
        Model.parse(3)


@pytest.mark.parametrize(
    ("text", "same"),
    [
        ("AR(phi=[1.4, -0.6])", "AR(2, phi1=1.4, phi2=-0.6)"),
        (
            "arma(phi=[fixed(0.5)], theta=[0.2], sigma2=2) + WN",
            "ARMA(1, 1, phi1=fixed(0.5), theta1=0.2, sigma2=2.0) + WN",
        ),
        ("SARMA(phi=[0.1], sphi=[0.5], period=12)", "SARMA(1, 0, 1, 0, 12, phi1=0.1, sphi1=0.5)"),
        ("AR(p=2)", "AR(2)"),
    ],
)
def test_coefficients_at_once(text, same):
    assert str(Model.parse(text)) == str(Model.parse(same))


@pytest.mark.parametrize("text", ["AR(phi=[1.4, -0.6)", "AR(phi=[1.4,, 2])", "AR(phi=[0.1], phi=[0.2])", "AR(p=two)"])
def test_wrong_lists_of_coefficients(text):
    with raises(ModelError, f'the model "{text}"'):
        Model.parse(text)
