"""Standard errors, confidence intervals, tests, the bootstrap and planning. Most are available as methods of a fit."""

from gmwm.inference.asymptotic import Sandwich
from gmwm.inference.bootstrap import Bootstrap
from gmwm.inference.criterion import Criterion
from gmwm.inference.goodness import GoodnessOfFit
from gmwm.inference.intervals import Interval
from gmwm.inference.noise_against import NoiseAgainst, noise_against
from gmwm.inference.planning import Plan, plan

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
