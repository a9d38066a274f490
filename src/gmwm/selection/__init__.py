"""Model selection: rank candidate models by an information criterion, with its uncertainty."""

from gmwm.selection.api import rank, select
from gmwm.selection.ranking import Candidate, Comparison, Ranking

__all__ = ["Candidate", "Comparison", "Ranking", "rank", "select"]
