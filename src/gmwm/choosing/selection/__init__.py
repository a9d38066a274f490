"""Model selection: rank candidate models by an information criterion, with its uncertainty."""

from gmwm.choosing.selection.api import rank, select
from gmwm.choosing.selection.ranking import Candidate, Comparison, Ranking

__all__ = ["Candidate", "Comparison", "Ranking", "rank", "select"]
