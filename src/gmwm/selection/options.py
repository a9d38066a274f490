"""Options of `select` and `rank`, checked when they are made."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from gmwm.inference.intervals import Method
from gmwm.options import as_confidence, as_whole_number, one_of

Weights = Literal["optimal", "diagonal"]
DRAWS = 500
FEWEST_DRAWS = 100


@dataclass(frozen=True, kw_only=True)
class RankingOptions:
    """Options of a ranking of models; `gmwm.select` describes each of them.

    Raises
    ------
    OptionError
        If a value is not one of those it may be.
    """

    weighting: Weights = "optimal"
    criterion: Method = "asymptotic"
    confidence: float = 0.95
    draws: int = DRAWS
    seed: int = 0

    def __post_init__(self) -> None:
        one_of(self.weighting, "weighting", ("optimal", "diagonal"))
        one_of(self.criterion, "criterion", ("asymptotic", "bootstrap"))
        as_confidence(self.confidence)
        as_whole_number(self.draws, "draws", FEWEST_DRAWS)
        as_whole_number(self.seed, "seed", 0)
