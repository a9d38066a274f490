"""Model selection: rank candidates by one criterion, with its uncertainty."""

from gmwm.selection.api import rank as rank
from gmwm.selection.api import select as select
from gmwm.selection.ranking import Candidate as Candidate
from gmwm.selection.ranking import Ranking as Ranking
