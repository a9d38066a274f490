"""Choosing a model: every candidate under one criterion, and which of them the data cannot tell apart."""

from gmwm.selection.api import rank, select
from gmwm.selection.ranking import Candidate, Comparison, Ranking

__all__ = ["Candidate", "Comparison", "Ranking", "rank", "select"]
