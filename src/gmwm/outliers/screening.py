"""Screen the samples of one axis: bursts, isolated wrong samples, and covariance from heavy tails, in one pass."""

from __future__ import annotations

from dataclasses import dataclass

from gmwm._arrays import Vector
from gmwm.covariance.tails import TailSums
from gmwm.outliers.bursts import BurstFinder, Bursts
from gmwm.outliers.spikes import find_spikes
from gmwm.signals import Signal
from gmwm.variance.panels import Panels, panel_length


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
    repaired : int
        Number of isolated wrong samples that were replaced; None if they are still in the data. They are then
        counted in panels of 131 072 samples or more.
    largest : float
        Largest deviation of those that were replaced.
    """

    def __init__(self, rate: float, repaired: int | None = None, largest: float = 0.0) -> None:
        self._rate, self._repaired = rate, repaired
        self._bursts, self._tails = BurstFinder(rate), TailSums()
        self._panels = Panels(panel_length(rate))
        self._spikes, self._largest = 0, largest

    def update(self, values: Vector) -> None:
        """Add the next samples of the segment."""
        self._bursts.update(values)
        self._tails.update(values)
        if self._repaired is None:
            for panel in self._panels.cut(values):
                self._count(panel)

    def gap(self) -> None:
        """End the segment: samples are missing before the next ones."""
        self._bursts.gap()
        self._tails.gap()
        for panel in self._panels.end():
            self._count(panel)

    def result(self) -> Screen:
        """The screen of all samples."""
        self.gap()
        return Screen(
            bursts=self._bursts.result(), spikes=self._spikes, repaired=self._repaired or 0, largest=self._largest,
            tails=self._tails,
        )  # fmt: skip

    def _count(self, panel: Vector) -> None:
        found = find_spikes(Signal(panel, self._rate))
        self._spikes += len(found)
        self._largest = max(self._largest, found.largest)


def screened(x: Signal, repaired: int | None = None, largest: float = 0.0) -> Screen:
    """Screen a signal in memory.

    Parameters
    ----------
    x : Signal
    repaired, largest
        As for `Screening`.

    Returns
    -------
    Screen
    """
    screening = Screening(x.rate, repaired, largest)
    for segment in x.segment_values():
        screening.update(segment)
        screening.gap()
    return screening.result()
