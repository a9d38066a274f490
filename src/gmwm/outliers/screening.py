"""Screen the samples of one axis: bursts, isolated wrong samples, and covariance from heavy tails, in one pass."""

from __future__ import annotations

from dataclasses import dataclass

from gmwm._arrays import Vector
from gmwm.batches import feed
from gmwm.covariance.tails import TailSums
from gmwm.outliers.bursts import BurstFinder, Bursts
from gmwm.outliers.spikes import find_spikes
from gmwm.signals import Signal


@dataclass(frozen=True, kw_only=True, eq=False)
class Screen:
    """What the samples of one axis say beyond their wavelet variances.

    Attributes
    ----------
    bursts : Bursts
        Knocks and motion.
    spikes : int
        Isolated wrong samples that are in the data.
    repaired : int
        Isolated wrong samples that were replaced before the wavelet variance was measured.
    largest : float
        Largest deviation of the isolated wrong samples, in local standard deviations.
    tails : TailSums
        Sums from which the covariance beyond a Gaussian signal follows.
    """

    bursts: Bursts
    spikes: int
    repaired: int
    largest: float
    tails: TailSums


class Screening:
    """Screen samples that arrive in chunks; the result does not depend on the chunks.

    Parameters
    ----------
    rate : float
        Sampling rate (Hz).
    """

    def __init__(self, rate: float) -> None:
        self._bursts, self._tails = BurstFinder(rate), TailSums()

    def update(self, values: Vector) -> None:
        """Add the next samples of the segment."""
        self._bursts.update(values)
        self._tails.update(values)

    def gap(self) -> None:
        """End the segment: samples are missing before the next ones."""
        self._bursts.gap()
        self._tails.gap()

    def result(self, *, spikes: int = 0, repaired: int = 0, largest: float = 0.0) -> Screen:
        """The screen of all samples, with the isolated wrong samples that were found beside it."""
        self.gap()
        bursts = self._bursts.result()
        return Screen(bursts=bursts, spikes=spikes, repaired=repaired, largest=largest, tails=self._tails)


def screened(x: Signal) -> Screen:
    """Screen a signal as it is.

    Parameters
    ----------
    x : Signal

    Returns
    -------
    Screen
    """
    screening, spikes = Screening(x.rate), find_spikes(x)
    feed(screening, x)
    return screening.result(spikes=len(spikes), largest=spikes.largest)
