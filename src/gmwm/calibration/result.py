"""The calibration of a unit: each axis with its model and numbers, and what to know before using them."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal, TypeVar

from gmwm._files import write_text
from gmwm._late import LateMethod
from gmwm._text import Summarised
from gmwm.calibration.recording_info import Recording
from gmwm.calibration.summary_text import summary
from gmwm.datasheets import Datasheet
from gmwm.errors import DataError, ReadError
from gmwm.estimation.result import Fit
from gmwm.inference.goodness import GoodnessOfFit
from gmwm.inference.intervals import Interval
from gmwm.outliers import Verdict
from gmwm.remarks import Remark
from gmwm.selection import Ranking

if TYPE_CHECKING:
    from matplotlib.figure import Figure

T = TypeVar("T")


@dataclass(frozen=True)
class Settings:
    """What was asked for; see `calibrate`.

    Attributes
    ----------
    within : str
        The largest model, as text.
    robust : "auto", True or False
        Which curve was to be fitted.
    weighting, criterion : str
        How models were fitted, and how they were compared.
    confidence, efficiency : float
        Of the intervals, and of the robust wavelet variance.
    draws, seed : int
        Of the simulated records.
    """

    within: str
    robust: Literal["auto"] | bool
    weighting: Literal["diagonal", "optimal"]
    criterion: Literal["asymptotic", "bootstrap"]
    confidence: float
    efficiency: float
    draws: int
    seed: int


@dataclass(frozen=True, eq=False)
class AxisCalibration:
    """One axis.

    Attributes
    ----------
    fit : Fit
        The recommended model with its estimates, certified, with weights of its own.
    intervals : mapping of name to (low, high)
        Confidence intervals of its parameters.
    test : GoodnessOfFit or None
        Of the recommended model; None where the levels do not suffice for one.
    datasheet : Datasheet
        The same in the terms of datasheets.
    ranking : Ranking
        All models that were compared.
    verdict : Verdict or None
        Whether outliers raise the classical curve; None where no signal was there to look at.
    needed : mapping of name to length (s)
        For parameters with a relative standard error above 50 %, how long a recording gives 20 %; infinite
        where none of a thousand times the length does, None where that is not known.
    """

    fit: Fit
    intervals: Mapping[str, Interval]
    test: GoodnessOfFit | None
    datasheet: Datasheet
    ranking: Ranking
    verdict: Verdict | None = None
    needed: Mapping[str, float | None] = field(default_factory=dict)

    @property
    def remarks(self) -> tuple[Remark, ...]:
        """What to know about the curve, the fit and its numbers."""
        # What a number includes besides its term must be known, or the term is counted twice.
        return tuple(dict.fromkeys((*self.fit.remarks, *self.datasheet.remarks)))


@dataclass(frozen=True, eq=False, repr=False)
class Calibration(Summarised, Mapping[str, Fit]):
    """The calibration of a unit; a mapping of axis to the recommended Fit.

    Attributes
    ----------
    axes : mapping of axis to AxisCalibration
        All that was found on each axis.
    failed : mapping of axis to str
        Axes that could not be calibrated, and why.
    settings : Settings
        What was asked for.
    source : str
        Where the recording came from.
    recording_remarks : tuple of Remark
        What an inspection of the recording found: motion, knocks, gaps, units.
    recording : Recording or None
        Its length, time base and file; None where it was no Imu.

    Examples
    --------
    >>> from gmwm import calibrate, simulate
    >>> imu = simulate({"gyro_x": "WN(sigma2=4e-7) + RW(gamma2=1e-11)"}, rate=100.0, samples=100_000, seed=1)
    >>> calibration = calibrate(imu, within="WN + RW")
    >>> list(calibration), calibration["gyro_x"].model.structure
    (['gyro_x'], 'WN + RW')
    >>> low, high = calibration.axes["gyro_x"].intervals["RW.gamma2"]
    >>> low < 1e-11 < high
    True
    >>> value, low, high, unit = calibration.datasheets["gyro_x"]["N"].in_units("deg/√h")
    >>> f"{value:.3f} {unit}"
    '0.217 deg/√h'
    """

    axes: Mapping[str, AxisCalibration]
    failed: Mapping[str, str]
    settings: Settings
    source: str = ""
    recording_remarks: tuple[Remark, ...] = ()
    recording: Recording | None = None

    plot: ClassVar[LateMethod[..., Figure]] = LateMethod(
        "gmwm.plots.imu:plot_imu",
        "Draw all axes with their models: a panel each, or with split=False a panel for each sensor; view=, units=, "
        "path=.",
    )
    export: ClassVar[LateMethod[..., str]] = LateMethod(
        "gmwm.exporters:export",
        "The noise as another program reads it: export(path, format='kalibr'); axes=, inflation=, horizon=, rate=.",
    )
    report: ClassVar[LateMethod[..., Path]] = LateMethod(
        "gmwm.reports:report", "Write all of it as one HTML page that needs nothing else: report(path)."
    )

    def __getitem__(self, axis: str) -> Fit:
        if axis in self.axes:
            return self.axes[axis].fit
        if axis in self.failed:
            raise DataError(f"{axis} could not be calibrated: {self.failed[axis]}")
        raise DataError(f"axis must be one of {', '.join(self.axes)}; got {axis!r}")

    def __iter__(self) -> Iterator[str]:
        return iter(self.axes)

    def __len__(self) -> int:
        return len(self.axes)

    def __contains__(self, axis: object) -> bool:
        return axis in self.axes

    def get(self, axis: str, default: Any = None) -> Any:
        """The fit of an axis, or `default` where there is none."""
        found = self.axes.get(axis)
        return default if found is None else found.fit

    @property
    def rankings(self) -> dict[str, Ranking]:
        """All models that were compared, by axis."""
        return self._each(lambda found: found.ranking)

    @property
    def datasheets(self) -> dict[str, Datasheet]:
        """N, Q, B, K, R and Gauss-Markov numbers, by axis."""
        return self._each(lambda found: found.datasheet)

    @property
    def verdicts(self) -> dict[str, Verdict]:
        """Whether outliers raise the classical curve, by axis; only of axes that were measured from a signal."""
        return {axis: found.verdict for axis, found in self.axes.items() if found.verdict is not None}

    @cached_property
    def remarks(self) -> list[Remark]:
        """Everything to know before using the calibration, the gravest first."""
        from gmwm.calibration.findings import remarks_of

        return remarks_of(self)

    @cached_property
    def verdict(self) -> Remark:
        """Whether the calibration can be used: the remark that heads its summary and its report."""
        from gmwm.calibration.findings import verdict_of

        return verdict_of(self)

    def of_file(self, path: str | os.PathLike[str]) -> Calibration:
        """The same with name, size and SHA-256 of the file `path` that the recording was read from."""
        return self if self.recording is None else replace(self, recording=self.recording.of_file(path))

    def summary(self, *, every: bool = False) -> str:
        """The verdict, a table for each sensor in the units of datasheets, and the gravest remarks.

        Parameters
        ----------
        every : bool
            Show all remarks instead of the gravest five.
        """
        return summary(self, every=every)

    def to_dict(self) -> dict[str, Any]:
        """The calibration as plain numbers, lists and texts: the document that docs/calibration-format.md describes."""
        from gmwm.calibration.document import document

        return document(self)

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> Calibration:
        """The calibration whose `to_dict` gave `content`.

        Raises
        ------
        ReadError
            If it is no calibration, of a newer version, or lacks something.
        """
        from gmwm.calibration.document import calibration

        return calibration(content)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the calibration to the JSON file `path`, whole or not at all; `load` reads it back to the last bit."""
        from gmwm.calibration.document import as_text

        write_text(path, as_text(self.to_dict()))

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Calibration:
        """The calibration in the file `path` that `save` or `gmwm calibrate` wrote.

        Raises
        ------
        ReadError
            If there is no such file, or it is no calibration, is cut short, or of a newer version.
        OSError
            If the file is there and cannot be opened.
        """
        from gmwm.calibration.document import read_text

        if not Path(path).exists():
            raise ReadError(f"{path} does not exist; looked in {Path(path).absolute().parent}")
        content = read_text(path)
        try:
            return cls.from_dict(content)
        except ReadError as error:
            raise ReadError(f"{path}: {error}") from error

    def __repr__(self) -> str:
        models = ", ".join(f"{axis}: {fit.model.structure}" for axis, fit in self.items())
        failed = f"; failed: {', '.join(self.failed)}" if self.failed else ""
        return f"Calibration({models}{failed})"

    def _each(self, of: Callable[[AxisCalibration], T]) -> dict[str, T]:
        return {axis: of(found) for axis, found in self.axes.items()}
