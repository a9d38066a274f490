"""Fill gaps with draws from the conditional distribution of lost samples given the samples around them."""

from gmwm.recording.gaps.blocks import fill_gaps, filled
from gmwm.recording.gaps.drawing import drawn
from gmwm.recording.gaps.gaps import is_short, joined_ranges

__all__ = ["drawn", "fill_gaps", "filled", "is_short", "joined_ranges"]
