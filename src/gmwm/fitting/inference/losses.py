"""Gaps of a planned recording."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gmwm.base.errors import OptionError
from gmwm.measuring.covariance import Design
from gmwm.measuring.variance.result import WaveletVariance


@dataclass(frozen=True)
class Losses:
    """Gaps of a planned recording, which repeat the gaps of a pilot recording. `filled`: share of the samples that are
    filled. `segments`: lengths of the segments of the pilot recording; () if all its gaps are filled or it has no gaps.

    >>> Losses(segments=(500, 1500)).design(1200, 100.0)[0].segments, Losses(segments=(500, 1500)).shortest(512)
    ((500, 700), 1012)
    """

    filled: float = 0.0
    segments: tuple[int, ...] = ()

    @classmethod
    def of(cls, wv: WaveletVariance | None) -> Losses:
        """Return the gaps of the recording with the wavelet variance `wv`; no gaps for None."""
        return cls() if wv is None else cls(wv.filled / wv.samples, wv.segments)

    def __bool__(self) -> bool:
        return bool(self.filled or self.segments)

    def shortest(self, least: int) -> int:
        """Return the length (samples) of the shortest recording with a segment of `least` samples. Raises OptionError
        if all segments are shorter than `least` samples."""
        before = 0
        for length in self.segments:
            if length >= least:
                return before + least
            before += length
        if self.segments:
            raise OptionError(
                argument="pilot", expected=f"a recording with a segment of {least} samples without a gap",
                got=max(self.segments), advice="Find out why samples are lost, or use a smaller model.",
            )  # fmt: skip
        return least

    def design(self, samples: int, rate: float) -> tuple[Design, float]:
        """Return the design of a recording of `samples` samples, and a factor by which its covariance is multiplied. If
        the segments are repeated m times, the design has one repetition, and the factor is 1/m."""
        filled, share, segments = round(self.filled * samples), 1.0, self.segments
        if not segments:
            return Design(np.arange(1, samples.bit_length()), samples, rate, filled=filled), share
        ends = np.cumsum(segments)
        if samples >= ends[-1]:
            share, samples = ends[-1] / samples, int(ends[-1])
        else:
            count = int(np.searchsorted(ends, samples))
            segments = (*segments[:count], samples - int(ends[count - 1] if count else 0))
        filled = round(self.filled * samples)
        levels = np.arange(1, max(segments).bit_length())
        return Design(levels, samples, rate, segments=segments, filled=filled), share


NONE = Losses()
"""No gaps."""
