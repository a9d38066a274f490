"""Standard errors, confidence intervals, tests, bootstrap and planning, which methods of a fit return."""

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
