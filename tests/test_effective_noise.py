"""N and K for a filter that has only two numbers: a zero never reaches it."""

import numpy as np
import pytest

import gmwm
from gmwm import GM, RW, WN
from tests.helpers import raises
from tests.test_datasheet import exact, near

# Terms that the data do not need are what this is about.
pytestmark = pytest.mark.filterwarnings("ignore::gmwm.errors.FitWarning")


def test_effective_noise_is_never_zero():
    # The only slow term is white noise over a long horizon: no walk is in the model, and no zero in the answer.
    fit = gmwm.fit("GM + WN", exact(GM(beta=0.5, sigma2=1e-8) + WN(sigma2=1e-6)))
    found = gmwm.datasheets.effective_noise(fit, 10.0)["K_eff"]
    assert (found.low, found.value, found.upper_only) == (0.0, found.high, True)
    wider = gmwm.fit("GM + WN + RW", exact(GM(beta=0.5, sigma2=1e-8) + WN(sigma2=1e-6)), certify=False)
    assert found.high == near(wider.datasheet()["K"].high, 1e-3)
    assert found.text().startswith("≤ ")
    white = gmwm.datasheets.effective_noise(gmwm.fit("RW", exact(RW(gamma2=1e-12))), 1.0)["N_eff"]
    assert white.value == white.high > white.low == 0
    # Where the data give no limit there is none, and still no zero.
    few = gmwm.datasheets.effective_noise(gmwm.fit("WN", np.random.default_rng(1).normal(size=8), rate=1.0), 1.0)[
        "K_eff"
    ]
    assert few.value == few.high > 0


def test_a_slow_term_counts_as_its_datasheet_says():
    # A time that is little known makes the interval wide; whether there is such a term its scale says.
    fit = gmwm.fit("GM + WN", exact(WN(sigma2=2e-4) + GM(beta=0.15, sigma2=1e-7)))
    entry, counted = fit.datasheet()["q_c"], gmwm.datasheets.effective_noise(fit, 1.0)["K_eff"]
    assert not entry.upper_only
    assert entry.high / entry.value > 2
    np.testing.assert_allclose([counted.value, counted.low, counted.high], [entry.value, entry.low, entry.high])
    assert not counted.upper_only


@pytest.mark.parametrize("given", ["WN", WN(sigma2=1.0), WN(sigma2=1.0) + RW(gamma2=1.0), None])
def test_only_a_fit_has_limits(given):
    with raises(gmwm.errors.OptionError, type(given).__name__, argument="fit", advises=["gmwm.fit(model, data)"]):
        gmwm.datasheets.effective_noise(given, 10.0)
