"""Choosing a model: every candidate under one criterion, and which of them the data cannot tell apart."""

from gmwm.selection.api import rank as rank
from gmwm.selection.api import select as select
from gmwm.selection.ranking import Candidate as Candidate
from gmwm.selection.ranking import Ranking as Ranking
