from fractions import Fraction

import numpy as np
import pytest

from gmwm.base.errors import ModelError
from gmwm.theory.processes import AR1, DR, GM, WN, Parameter, fixed
from tests.helpers import raises


@pytest.mark.parametrize("value", [2, 2.0, np.float64(2), np.float32(2), np.int64(2), Fraction(2)])
def test_every_real_number_becomes_a_float(value):
    assert type(WN(sigma2=value).sigma2) is float
    assert WN(sigma2=value) == WN(sigma2=2.0)
    assert type(fixed(value).value) is float


@pytest.mark.parametrize(
    ("build", "argument", "expected", "got"),
    [
        (lambda: WN(sigma2=True), "WN.sigma2", "a number", "True"),
        (lambda: WN(sigma2="1"), "WN.sigma2", "a number", "'1'"),
        (lambda: WN(sigma2=1j), "WN.sigma2", "a number", "1j"),
        (lambda: WN(sigma2=np.ones(1)), "WN.sigma2", "a number", "array([1.])"),
        (lambda: WN(sigma2=float("nan")), "WN.sigma2", "finite", "nan"),
        (lambda: WN(sigma2=fixed(-1.0)), "WN.sigma2", "zero or positive (u²)", "-1.0"),
        (lambda: GM(beta=0.0), "GM.beta", "positive (1/s)", "0.0"),
        (lambda: GM(beta=float("inf")), "GM.beta", "finite", "inf"),
        (lambda: AR1(phi=1.0), "AR1.phi", "strictly between -1 and 1", "1.0"),
        (lambda: AR1(phi=-1), "AR1.phi", "strictly between -1 and 1", "-1"),
        (lambda: fixed(None), "a fixed value", "a number", "None"),
        (lambda: fixed(fixed(1.0)), "a fixed value", "a number", "fixed(1.0)"),
        (lambda: fixed(False), "a fixed value", "a number", "False"),
    ],
)
def test_values_are_checked_at_the_door(build, argument, expected, got):
    with raises(ModelError, argument, f"got {got}", argument=argument, expected=expected):
        build()


def test_zero_is_a_legal_scale_and_any_sign_a_legal_slope():
    assert GM(beta=1.0, sigma2=0).wavelet_variance(3, 1.0).tolist() == [0.0, 0.0, 0.0]
    assert DR(omega=-2.0).scale == 4.0
    assert DR(omega=-2.0).simulate(3, 1.0, 1).tolist() == [0.0, -2.0, -4.0]


@pytest.mark.parametrize(
    ("powers", "per_sample", "unit"),
    [
        ((2, 0), False, "(m/s²)²"),
        ((1, 0), True, "m/s² per sample"),
        ((0, -1), False, "1/s"),
        ((0, -2), False, "1/s²"),
        ((2, -1), False, "(m/s²)²/s"),
        ((1, 1), False, "m/s²·s"),
        ((0, 2), False, "s²"),
        ((0, 0), True, ""),
    ],
)
def test_unit_text(powers, per_sample, unit):
    parameter = Parameter("x", "x", "x", signal_power=powers[0], time_power=powers[1], per_sample=per_sample)
    assert parameter.unit("m/s²") == unit
