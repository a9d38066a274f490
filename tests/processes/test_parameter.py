from fractions import Fraction

import numpy as np
import pytest

from gmwm.errors import ModelError
from gmwm.processes import AR1, DR, GM, WN, Parameter, fixed


@pytest.mark.parametrize("value", [2, 2.0, np.float64(2), np.float32(2), np.int64(2), Fraction(2)])
def test_every_real_number_becomes_a_float(value):
    assert type(WN(sigma2=value).sigma2) is float
    assert WN(sigma2=value) == WN(sigma2=2.0)
    assert type(fixed(value).value) is float


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: WN(sigma2=True), "WN.sigma2 must be a number, got True; leave it out to have it estimated"),
        (lambda: WN(sigma2="1"), "must be a number, got '1'"),
        (lambda: WN(sigma2=1j), "must be a number"),
        (lambda: WN(sigma2=np.ones(1)), "must be a number"),
        (lambda: WN(sigma2=float("nan")), "WN.sigma2 must be finite, got nan"),
        (lambda: WN(sigma2=fixed(-1.0)), r"WN.sigma2 \(variance\) must be zero or positive \(u²\), got -1.0"),
        (lambda: GM(beta=0.0), r"GM.beta \(inverse correlation time\) must be positive \(1/s\), got 0.0"),
        (lambda: GM(beta=float("inf")), "GM.beta must be finite"),
        (lambda: AR1(phi=1.0), "AR1.phi .* must lie strictly between -1 and 1, got 1.0"),
        (lambda: AR1(phi=-1), "strictly between -1 and 1, got -1"),
        (lambda: fixed(None), "a fixed value must be a number, got None"),
        (lambda: fixed(fixed(1.0)), "must be a number"),
        (lambda: fixed(False), "must be a number, got False"),
    ],
)
def test_values_are_checked_at_the_door(build, message):
    with pytest.raises(ModelError, match=message):
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
