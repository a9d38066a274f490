"""Fill the gaps of a recording with draws from the conditional distribution of lost samples given the samples around
them."""

from gmwm.filling.blocks import fill_gaps, filled
from gmwm.filling.drawing import drawn
from gmwm.filling.gaps import is_short, joined_ranges

__all__ = ["drawn", "fill_gaps", "filled", "is_short", "joined_ranges"]
