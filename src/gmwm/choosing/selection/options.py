"""Options of `select` and `rank`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from gmwm.recording.options import as_confidence, as_whole_number, one_of

if TYPE_CHECKING:
    from gmwm.fitting.estimation.intervals import Method

Weights = Literal["optimal", "diagonal"]
SLOW = "4*GM + WN + QN + FN + RW + DR"
"""General model whose submodels a search ranks first (docs/validation/selection.md)."""
DRAWS = 500
"""Default number of simulated recordings."""


@dataclass(frozen=True, kw_only=True)
class RankingOptions:
    """Options of a ranking of models, whose values are checked. `gmwm.select` describes each option."""

    weighting: Weights = "optimal"
    criterion: Method = "asymptotic"
    confidence: float = 0.95
    draws: int = DRAWS
    seed: int = 0

    def __post_init__(self) -> None:
        one_of(self.weighting, "weighting", ("optimal", "diagonal"))
        one_of(self.criterion, "criterion", ("asymptotic", "bootstrap"))
        as_confidence(self.confidence)
        # Smallest number of simulated recordings that is allowed.
        as_whole_number(self.draws, "draws", 100)
        as_whole_number(self.seed, "seed", 0)
