"""Planning of recordings, dependence of noise on a condition, and the results of the methods of a fit."""

from gmwm.fitting.estimation.asymptotic import Sandwich
from gmwm.fitting.estimation.bootstrap import Bootstrap
from gmwm.fitting.estimation.criterion import Criterion
from gmwm.fitting.estimation.goodness import GoodnessOfFit
from gmwm.fitting.estimation.intervals import Interval
from gmwm.fitting.inference.noise_against import NoiseAgainst, noise_against
from gmwm.fitting.inference.planning import Plan, plan

__all__ = [
    "Bootstrap", "Criterion", "GoodnessOfFit", "Interval", "NoiseAgainst", "Plan", "Sandwich", "noise_against", "plan",
]  # fmt: skip
