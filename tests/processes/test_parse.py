import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gmwm.errors import ModelError
from gmwm.processes import AR, AR1, ARMA, DR, GM, MA, QN, RW, SARMA, WN, Model, fixed, registry

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


@profile
@given(models())
def test_the_representation_of_a_process_is_python(model):
    names = {**registry, "fixed": fixed}
    for process in model.processes:
        assert eval(repr(process), {"__builtins__": {}}, names) == process


@profile
@given(st.text(alphabet="GMWNQRDA13*+-()=,. efixdbtasgm2_\n\"'[]é", max_size=40) | st.text(max_size=20))
def test_any_text_is_a_model_or_a_model_error(text):
    try:
        model = Model.parse(text)
    except ModelError:
        return
    assert Model.parse(str(model)) == model


@pytest.mark.parametrize(
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


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("GM + XX", r'at "XX" \(character 6\): no process of this name; there are WN, QN, RW, DR, AR1, GM'),
        ("", "at the end: expected a process, one of WN"),
        ("GM +", "at the end: expected a process"),
        ("GM WN", r'at "WN" \(character 4\): expected "\+" or the end'),
        ("3 GM", r'expected "\*" between a count and a process, as 3\*GM'),
        ("2.5*GM", r'at "2.5" \(character 1\): expected a count from 1 to 100'),
        ("0*GM", "expected a count"),
        ("99999999999999*GM", "expected a count"),
        ("GM*x", r'at "x" \(character 4\): expected a count'),
        ("GM([0.01])", r"expected a parameter by name, as GM\(beta=…\)"),
        ("GM(beta=0.1, 0.2)", r'at "0.2" \(character 14\): a value without a name comes before those with one'),
        ("GM(0.1, 0.2, 0.3)", r'at "0.3" .*GM has no more parameters than beta, sigma2'),
        ("GM(0.1, beta=0.2)", r'at "beta" .*given twice'),
        ("GM(0.1, -1)", r'at "-" .*GM.sigma2'),
        ("GM(alpha=1)", r'at "alpha" .*GM has no such parameter; it has beta, sigma2'),
        ("GM(beta=1, beta=2)", "given twice"),
        ("GM(beta 1)", 'expected "=" after beta'),
        ("GM(beta=1 sigma2=1)", r'expected "," between parameters'),
        ("GM(beta=-1)", r'at "-" .*GM.beta .inverse correlation time. must be positive .1/s., got -1.0'),
        ("GM(beta=inf)", r'at "inf" .*expected a finite number'),
        ("GM(beta=1e999)", r'at "1e999" .*expected a finite number'),
        ("GM(beta=fixed 1)", r'expected "\(" after fixed'),
        ("GM(beta=fixed(1)", "at the end"),
        ("GM - WN", r'at "-" \(character 4\): expected "\+"'),
        ("GM; import os", r'at ";" \(character 3\): this character has no place'),
        ("__import__('os')", "this character has no place"),
        ("__import__(os)", r'at "__import__" \(character 1\): no process of this name'),
        ("WN + WN", "WN cannot be repeated"),
        ("+".join(["GM"] * 5000), "at most 10000 characters|at most 100 terms"),
        ("+".join(["GM"] * 200), "at most 100 terms"),
        ("100*GM + 100*GM", "at most 100 terms, got 200"),
        ("GM + XX", r"AR\(p\), MA\(q\), ARMA\(p, q\), SARMA\(p, q, P, Q, period\)"),
        ("WN + AR", r'at "AR" \(character 6\): AR is written with its orders, AR\(p\)'),
        ("AR()", r'at "AR" \(character 1\): AR is written with its orders'),
        ("AR(2", 'at the end: expected "," between orders and parameters'),
        ("AR(2, 3)", r'at "3" .*phi1 .* between -2 and 2, got 3'),
        ("ARMA(2)", r'at "ARMA" .* got 1 orders'),
        ("AR(2.5)", r'at "2.5" \(character 4\): expected an order, a whole number'),
        ("AR(99999999999)", "reaches back"),
        ("AR(2 phi1=1)", r'at "phi1" .*expected "," between'),
        ("ARMA(2, 0.5)", r'at "0.5" .*expected an order'),
        ("AR(2, phi1=0.5, 1)", r"a value without a name comes before those with one; write phi1=…"),
        ("AR(1, phi2=0.5)", r'at "phi2" .*AR\(1\) has no such parameter; it has phi1, sigma2'),
        ("WN + AR(1, phi1=1.5)", r'at "1.5" \(character 17\): AR\(1\).phi1 .* between -1 and 1, got 1.5'),
        ("WN + AR(2, phi1=1.5, phi2=0.2)", r'at "AR" \(character 6\): AR\(2\) must be stationary'),
        ("SARMA(1, 0, 1, 0, period 12)", 'expected "=" after period'),
        ("2*AR(2)", r"a sum of 2 is an ARMA\(4,2\)"),
    ],
)
def test_an_error_points_at_the_piece(text, message):
    with pytest.raises(ModelError, match=message):
        Model.parse(text)


def test_only_a_string_is_parsed():
    with pytest.raises(ModelError, match="must be a string"):
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
    with pytest.raises(ModelError, match="cannot read the model"):
        Model.parse(text)
