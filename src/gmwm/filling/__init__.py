"""Fill the gaps of a recording: draw lost samples from their conditional distribution given the samples around them."""

from gmwm.filling.blocks import fill_gaps, filled
from gmwm.filling.drawing import drawn
from gmwm.filling.gaps import is_short, joined_ranges

__all__ = ["drawn", "fill_gaps", "filled", "is_short", "joined_ranges"]
