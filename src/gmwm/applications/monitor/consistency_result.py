"""Results of the comparison between the claimed and the real error of a filter."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from gmwm.base.documents import plain, plain_fields
from gmwm.base.plotting import Plotted, register
from gmwm.base.text import Summarised, align, duration_text
from gmwm.choosing.datasheets.effective import TRUE_CLAIM

WIDEST_INTERVAL = 2.0
"""Largest ratio of the limits of an interval that decides. A filter that claims half of its error is then detected.
Pinned by tests/monitor/test_consistency.py."""
OF_SAMPLES = (
    "NIS: mean normalised innovation squared of single samples; r₁: autocorrelation of the innovations. They differ\n"
    "from 1 and 0 if the sensor filters or rounds its output, which N and K do not describe. They do not decide ✓ or ✗."
)
MARKS = {"consistent": "✓", "overconfident": "✗", "cautious": "✗", "undecided": "?"}


@dataclass(frozen=True, kw_only=True)
class PredictionError:
    """Error with which a filter predicts the mean of the signal over the next `horizon`.

    Attributes
    ----------
    horizon : float
        Horizon (s).
    claimed, real : float
        Root mean square error that the filter claims, and that it makes, in the unit of the signal.
    low, high : float
        Confidence limits of `claimed / real`, for the number of independent errors. They are 0 and infinite, and
        `real` is NaN, if the recording is too short.
    independent : float
        Number of independent errors: the number of squared errors divided by their correlation in time.
    """

    horizon: float
    claimed: float
    real: float
    low: float
    high: float
    independent: float

    @property
    def ratio(self) -> float:
        """Claimed over real error; NaN if the recording is too short."""
        return self.claimed / self.real

    @property
    def nees(self) -> float:
        """Mean of the normalised squared error, (real / claimed)²; 1 for a consistent filter."""
        return self.ratio**-2

    @property
    def verdict(self) -> str:
        """ "consistent", "overconfident" (claims less than its error), "cautious" (claims more) or "undecided"."""
        least, most = TRUE_CLAIM
        if self.ratio < least and self.high < 1:
            return "overconfident"
        if self.ratio > most and self.low > 1:
            return "cautious"
        decides = least <= self.ratio <= most and self.high <= WIDEST_INTERVAL * self.low
        return "consistent" if decides else "undecided"

    def to_dict(self) -> dict[str, Any]:
        """Return the error as plain values for JSON."""
        return plain_fields(self, "horizon claimed real ratio low high nees independent verdict")


@dataclass(frozen=True, kw_only=True)
class AxisConsistency:
    """Claimed and real errors of the filter of one axis.

    Attributes
    ----------
    axis, unit : str
        Name of the axis, and unit of the signal.
    model : str
        Noise model of the filter with its values, per sample.
    nis : float
        Mean normalised innovation squared ν²/S of single samples; 1 for a consistent filter.
    nis_band : (float, float)
        Limits of `nis` for a consistent filter from the χ² distribution, for the number of independent innovations.
    correlation : float
        Autocorrelation of the innovations at the lag of one sample; 0 for a consistent filter.
    errors : tuple of PredictionError
        The errors at the horizons of the verdict.
    curve : tuple of PredictionError
        The errors at horizons of 1, 2, 4, … samples, for the plot.
    limits : tuple of str
        Numbers of the filter that are upper limits, such as "K". A filter with a limit is cautious.
    """

    axis: str
    unit: str
    model: str
    nis: float
    nis_band: tuple[float, float]
    correlation: float
    errors: tuple[PredictionError, ...]
    curve: tuple[PredictionError, ...]
    limits: tuple[str, ...] = ()

    @property
    def verdict(self) -> str:
        """ "overconfident" if the filter is at any horizon, else "cautious", "undecided" or "consistent"."""
        verdicts = {error.verdict for error in self.errors}
        return next(verdict for verdict in ("overconfident", "cautious", "undecided", "consistent")
                    if verdict in verdicts)  # fmt: skip

    @property
    def inflation(self) -> float:
        """Factor on N and K, or on all standard deviations of the model, with which the filter is nowhere
        overconfident; at least 1."""
        return max([1.0, *(1 / error.ratio for error in self.errors if error.verdict == "overconfident")])

    def reason(self) -> str:
        """Describe the verdict in one sentence."""
        verdict = self.verdict
        errors = [error for error in self.errors if error.verdict == verdict]
        at = ", ".join(duration_text(error.horizon) for error in errors)
        if verdict == "undecided":
            return f"{self.axis} is undecided at {at}: the recording is too short, so record longer."
        if verdict == "consistent":
            return f"{self.axis} is consistent: the filter claims the error that it makes."
        worst = max(errors, key=lambda error: abs(math.log(error.ratio)))
        claim = f"over {duration_text(worst.horizon)}, it claims {worst.ratio:.2f} ({worst.low:.2f} … {worst.high:.2f})"
        if verdict == "cautious":
            cause = f"{' and '.join(self.limits)} is an upper limit." if self.limits else "A smaller N or K is enough."
            return f"{self.axis} is cautious at {at}: {claim} times its error. {cause}"
        return (
            f"{self.axis} is overconfident at {at}: {claim} of its error. An inflation of "
            f"{math.ceil(100 * self.inflation) / 100:g} is enough."
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the errors as plain values for JSON."""
        facts = plain_fields(self, "unit model limits nis nis_band correlation verdict inflation errors curve")
        return {**facts, "reason": self.reason()}


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Consistency(Summarised, Plotted, Mapping[str, AxisConsistency]):
    """Claimed and real errors of filters: a mapping of axis to `AxisConsistency`.

    Attributes
    ----------
    axes : mapping of axis to AxisConsistency
        Errors and verdict of each axis.
    filter : str
        The form of the filter: "N, K", "N, sigma, T" or "model".
    duration, rate : float
        Length (s) and sampling rate (Hz) of the recording.
    level : float
        Confidence level of intervals and bands.
    """

    axes: Mapping[str, AxisConsistency]
    filter: str
    duration: float
    rate: float
    level: float

    def __getitem__(self, axis: str) -> AxisConsistency:
        return self.axes[axis]

    def __iter__(self) -> Iterator[str]:
        return iter(self.axes)

    def __len__(self) -> int:
        return len(self.axes)

    def summary(self) -> str:
        """Return one line for each axis, and the reason of each axis whose filter is not consistent."""
        share, kind = f"{100 * self.level:g} %", "the whole model" if self.filter == "model" else self.filter
        results = list(self.values())
        count, over = (
            sum(result.verdict == verdict for result in results) for verdict in ("consistent", "overconfident")
        )
        rows = [["", "", *(duration_text(error.horizon) for error in results[0].errors), "NIS", "its band", "r₁"]]
        for axis, result in self.items():
            low, high = result.nis_band
            cells = [axis, MARKS[result.verdict], *map(_ratio, result.errors), f"{result.nis:.3f}"]
            rows.append([*cells, f"{low:.3f} … {high:.3f}", f"{result.correlation:+.2f}"])
        lines = [
            f"Filters with {kind}: consistent on {count} of {len(self)} axes, overconfident on {over}, in "
            f"{duration_text(self.duration)}.",
            f"Claimed over real error of the mean over the next T ({share} interval); ✓ is 0.8 to 1.3:",
            *align(rows, right=range(2, len(rows[0]))),
            *(result.reason() for result in results if result.verdict != "consistent"),
        ]
        if any(not result.nis_band[0] <= result.nis <= result.nis_band[1] for result in results):
            lines.append(OF_SAMPLES)
        return "\n".join(lines)

    def to_dict(self) -> dict[str, Any]:
        """Return the results as plain values for JSON."""
        return {**plain_fields(self, "filter duration rate level"), "axes": plain(dict(self.axes))}


def _ratio(error: PredictionError) -> str:
    if math.isnan(error.ratio):
        return "too short"
    return f"{error.ratio:.2f} ({error.low:.2f} … {error.high:.2f}) {MARKS[error.verdict]}"


register(Consistency, "gmwm.applications.monitor.plot:plot_consistency")
