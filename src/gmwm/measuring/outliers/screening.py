"""Screen the samples of one axis in one pass for bursts, isolated wrong samples and heavy tails."""

from __future__ import annotations

from dataclasses import dataclass

from gmwm.base.arrays import Vector
from gmwm.base.documents import Documented
from gmwm.measuring.covariance.tails import TailSums
from gmwm.measuring.outliers.bursts import BurstFinder, Bursts
from gmwm.measuring.outliers.spikes import find_spikes
from gmwm.recording.batches import feed
from gmwm.recording.signals import Signal


@dataclass(frozen=True, kw_only=True)
class Replaced(Documented):
    """Samples of one axis that were replaced before the measurement. `spikes` and `in_knocks` are the numbers of
    isolated wrong samples and of samples in knocks, `largest` the largest deviation of the former in local standard
    deviations. `left` is the sum of the squares of wrong samples that are too small to be found.
    `knocks` has the begin and end (s) of each knock, counted like the option `skip` of `read`."""

    spikes: int = 0
    largest: float = 0.0
    knocks: tuple[tuple[float, float], ...] = ()
    in_knocks: int = 0
    left: float = 0.0

    def __add__(self, other: Replaced) -> Replaced:
        return Replaced(
            spikes=self.spikes + other.spikes, largest=max(self.largest, other.largest),
            knocks=self.knocks + other.knocks, in_knocks=self.in_knocks + other.in_knocks,
            left=self.left + other.left,
        )  # fmt: skip


NOTHING_REPLACED = Replaced()


@dataclass(frozen=True, kw_only=True, eq=False)
class Screen:
    """Results of the screening of one axis: bursts, wrong samples in the data (as in `Replaced`), and sums for heavy
    tails."""

    bursts: Bursts
    spikes: int
    largest: float
    replaced: Replaced
    tails: TailSums


class Screening:
    """Screen samples that arrive in chunks; the result does not depend on the chunks."""

    def __init__(self, rate: float) -> None:
        self._bursts, self._tails = BurstFinder(rate), TailSums()

    def update(self, values: Vector) -> None:
        """Add the next samples of the segment."""
        self._bursts.update(values)
        self._tails.update(values)

    def gap(self) -> None:
        """End the segment, because samples are missing before the next ones."""
        self._bursts.gap()
        self._tails.gap()

    def result(self, *, spikes: int = 0, largest: float = 0.0, replaced: Replaced = NOTHING_REPLACED) -> Screen:
        """Return the results for all samples, with the isolated wrong samples that were found separately."""
        self.gap()
        bursts = self._bursts.result()
        return Screen(bursts=bursts, spikes=spikes, largest=largest, replaced=replaced, tails=self._tails)


def screened(x: Signal) -> Screen:
    """Screen a signal without replacing samples."""
    screening, spikes = Screening(x.rate), find_spikes(x)
    feed(screening, x)
    return screening.result(spikes=len(spikes), largest=spikes.largest)
