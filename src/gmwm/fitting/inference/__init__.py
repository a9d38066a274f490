"""Standard errors, confidence intervals, tests, the bootstrap and planning. Most are available as methods of a fit."""

from gmwm.fitting.inference.asymptotic import Sandwich
from gmwm.fitting.inference.bootstrap import Bootstrap
from gmwm.fitting.inference.criterion import Criterion
from gmwm.fitting.inference.goodness import GoodnessOfFit
from gmwm.fitting.inference.intervals import Interval
from gmwm.fitting.inference.noise_against import NoiseAgainst, noise_against
from gmwm.fitting.inference.planning import Plan, plan

__all__ = [
    "Bootstrap",
    "Criterion",
    "GoodnessOfFit",
    "Interval",
    "NoiseAgainst",
    "Plan",
    "Sandwich",
    "noise_against",
    "plan",
]
