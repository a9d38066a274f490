"""The answer to "do these differ?": tests of parts against the others, whatever the parts are."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass

from gmwm.base.plotting import Plotted
from gmwm.base.text import Summarised


@dataclass(frozen=True, kw_only=True)
class Difference:
    """Ratio of one part, such as a recording or a unit, to the others, and the test whether they differ.

    Attributes
    ----------
    name : str
        What is compared, such as "gyro_x at 0.02 s, monday".
    ratio : float
        The ratio, 1 if there is no difference.
    lower, upper : float or None
        Confidence limits of the ratio; None if they are not known.
    pvalue : float or None
        p-value of no difference, adjusted for the number of tests; None if there is no test.
    differs : bool
        Whether the test finds a difference.
    """

    name: str
    ratio: float
    lower: float | None = None
    upper: float | None = None
    pvalue: float | None = None
    differs: bool = False


class DifferenceTests(Summarised, Plotted):
    """Base of results that answer whether parts differ: recordings, calibrations, units of a fleet, or conditions."""

    @property
    @abstractmethod
    def tests(self) -> tuple[Difference, ...]:
        """All comparisons in one form, for plots and for programs that handle every kind of comparison."""
