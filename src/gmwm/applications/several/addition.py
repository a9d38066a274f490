"""The test for noise that the axes of a recording share, as an addition to a calibration."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

from gmwm.applications.several.block_means import shared_noise
from gmwm.applications.several.result import SharedNoise
from gmwm.base.remarks import Quantity, Remark
from gmwm.calibration.additions import RecordingAddition
from gmwm.calibration.findings import TEST_SIZE
from gmwm.calibration.recording_findings import pairs_facts

if TYPE_CHECKING:
    from gmwm.recording.signals import Signal


class SharedNoiseAddition(RecordingAddition):
    """The scales at which two axes of a recording share noise."""

    def needs(self, axes: Sequence[str]) -> bool:
        """Return whether there are at least two axes."""
        return len(axes) > 1

    def of_recording(self, signals: Mapping[str, Signal], *, threads: int | None = None) -> tuple[SharedNoise, ...]:
        """Test all pairs of axes."""
        return shared_noise(signals, threads=threads, fill=False)

    def remarks(self, finding: Sequence[SharedNoise], axes: Collection[str], size: float) -> Iterator[Remark]:
        """Yield one remark if any of these axes share noise at this significance level. Axes with remaining motion or
        knocks must be left out. These affect several axes at once without being shared noise."""
        pairs = [pair for pair in finding if pair.pvalue <= size and set(pair.axes) <= set(axes)]
        if pairs:
            pairs.sort(key=lambda pair: -abs(pair.correlation))
            strongest = pairs[0]
            first, second = strongest.axes
            yield Remark.of(
                "noise-shared", case="calibration",
                **pairs_facts(tuple(dict.fromkeys("/".join(pair.axes) for pair in pairs))),
                first=first, second=second, correlation=strongest.correlation, tau=Quantity(strongest.tau, "s"),
                size=TEST_SIZE,
            )  # fmt: skip
