"""Result of `calibrate`: the model and the numbers of each axis, with remarks and a verdict."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path, PureWindowsPath
from typing import TYPE_CHECKING, Any, TypeVar

from gmwm.base.atomic_files import write_text
from gmwm.base.errors import DataError, ReadError
from gmwm.base.remarks import Dialect, Remark, Severity
from gmwm.base.results import Plotted, Tabular
from gmwm.base.text import Summarised
from gmwm.calibration.options import AGAIN, CalibrationOptions
from gmwm.calibration.recording_info import Recording
from gmwm.calibration.rest import BiasAtRest
from gmwm.choosing.datasheets import Datasheet
from gmwm.choosing.selection import Ranking
from gmwm.choosing.selection.ranking import SearchStep
from gmwm.fitting.estimation.goodness import GoodnessOfFit
from gmwm.fitting.estimation.intervals import Interval
from gmwm.fitting.estimation.model_error import RelativeMisfit
from gmwm.fitting.estimation.result import Fit
from gmwm.measuring.outliers import Verdict
from gmwm.measuring.regression.result import Regression
from gmwm.measuring.spectrum import PowerSpectrum

if TYPE_CHECKING:
    from polars import DataFrame

    from gmwm.applications.monitor import Baseline
    from gmwm.applications.navigation import Budget
    from gmwm.calibration.number_verdicts import NumberVerdict
    from gmwm.calibration.reference_check import ReferenceCheck, ReferenceLike
    from gmwm.choosing.replicates import Replicates
    from gmwm.showing.exporters.reduction import Rule

T = TypeVar("T")


@dataclass(frozen=True, kw_only=True, eq=False)
class AxisCalibration:
    """The calibration of one axis.

    Attributes
    ----------
    fit : Fit
        The fit of the recommended model. Its certificate holds given the filter and the lines taken from the spectrum.
    intervals : mapping of name to (low, high)
        Confidence intervals of the parameters, which include the uncertainty of the model choice.
    test : GoodnessOfFit or None
        Goodness-of-fit test of the recommended model; None if there are too few levels for a test.
    datasheet : Datasheet
        The datasheet numbers: N, Q, B, K, R and those of Gauss-Markov terms.
    ranking : Ranking
        All models that were compared.
    verdict : Verdict or None
        Test whether outliers raise the classical wavelet variance; None if the data were a wavelet variance.
    needed : mapping of name to float or None
        For each parameter with a relative standard error above 50 %, the recording length (s) that would reduce it to
        20 %. It is infinite if 1024 times the length is not enough, and None if it is not known.
    misfit : RelativeMisfit or None
        Relative difference between the model and the measured wavelet variance at each scale.
    model_error : float
        Relative standard deviation of the difference between the model and the true wavelet variance at each scale, in
        addition to the scatter of the data. The intervals include it.
    tried : tuple of str
        The families of models that the search tried, in order.
    search : tuple of SearchStep
        The steps of the search: each family with the p-values of its models, and why it was entered and left.
    spectrum : PowerSpectrum or None
        Power spectral density with its lines and bumps, averaged over 1/24 octave except at lines; None if the data
        were a wavelet variance, or if the recording has fewer than 64 samples without a gap.
    regression : Regression or None
        Regression on the temperature or on other conditions, even if the axis does not follow them.
    left_in : float or None
        K (SI) that would result if the effect of the conditions were not removed; None if nothing is removed, or if
        this K could not be estimated.
    rest : BiasAtRest or None
        Bias at rest; None if the data were a wavelet variance.
    additions : mapping of name to object
        What applications have computed, such as the "baseline" with which `gmwm.Monitor` compares later samples.
    """

    fit: Fit
    intervals: Mapping[str, Interval]
    test: GoodnessOfFit | None
    datasheet: Datasheet
    ranking: Ranking
    verdict: Verdict | None = None
    needed: Mapping[str, float | None] = field(default_factory=dict)
    misfit: RelativeMisfit | None = None
    model_error: float = 0.0
    tried: tuple[str, ...] = ()
    search: tuple[SearchStep, ...] = ()
    spectrum: PowerSpectrum | None = None
    regression: Regression | None = None
    left_in: float | None = None
    rest: BiasAtRest | None = None
    additions: Mapping[str, Any] = field(default_factory=dict)

    @property
    def replicates(self) -> Replicates | None:
        """Comparison of several recordings; None for a single recording."""
        return self.fit.replicates

    @property
    def regressions(self) -> dict[str, Regression]:
        """The regressions whose effect was removed, by name of the recording; a single recording has the name ""."""
        if self.regression is not None:
            return {"": self.regression} if self.regression.applied else {}
        curves = self.fit.wavelet_variance.recordings
        return {name: wv.regression for name, wv in curves.items() if wv.regression is not None}

    @property
    def remarks(self) -> tuple[Remark, ...]:
        """Remarks on the wavelet variance, the fit and the datasheet numbers."""
        # The remarks of the datasheet state which terms a number includes, so that users do not count a term twice.
        return tuple(dict.fromkeys((*self.fit.remarks, *self.datasheet.remarks)))


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Calibration(Summarised, Plotted, Tabular, Mapping[str, Fit]):
    """The calibration of an inertial sensor: a mapping of axis to the recommended Fit.

    Attributes
    ----------
    axes : mapping of axis to AxisCalibration
        Fit, intervals, test, datasheet and ranking of each axis.
    failed : mapping of axis to str
        Axes that could not be calibrated, with the reason.
    settings : CalibrationOptions
        The options of the calibration.
    source : str
        Name of the recording.
    recording_remarks : tuple of Remark
        Remarks of the inspection of the recording: motion, knocks, gaps, units.
    recording : Recording or None
        Length, time base and file of the recording; None if the data were several recordings or not a recording.
    recordings : mapping of name to Recording
        Length, time base and file of each of several recordings of the unit; empty for a single recording.

    Examples
    --------
    >>> from gmwm import calibrate, simulate
    >>> imu = simulate({"gyro_x": "WN(sigma2=4e-7) + RW(gamma2=1e-11)"}, rate=100.0, samples=100_000, rng=1)
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
    settings: CalibrationOptions
    source: str = ""
    recording_remarks: tuple[Remark, ...] = ()
    recording: Recording | None = None
    recordings: Mapping[str, Recording] = field(default_factory=dict)

    def __getitem__(self, axis: str) -> Fit:
        if axis in self.axes:
            return self.axes[axis].fit
        if axis in self.failed:
            raise DataError(f"{axis} could not be calibrated: {self.failed[axis]}", argument="axis", got=axis)
        raise DataError(argument="axis", expected=f"one of {', '.join(self.axes)}", got=axis)

    def __iter__(self) -> Iterator[str]:
        return iter(self.axes)

    def __len__(self) -> int:
        return len(self.axes)

    def __contains__(self, axis: object) -> bool:
        return axis in self.axes

    def get(self, axis: str, default: Any = None) -> Any:
        """Return the fit of an axis, or `default` if the axis was not calibrated."""
        axis_calibration = self.axes.get(axis)
        return default if axis_calibration is None else axis_calibration.fit

    @property
    def rankings(self) -> dict[str, Ranking]:
        """All models that were compared, by axis."""
        return self._each(lambda item: item.ranking)

    @property
    def datasheets(self) -> dict[str, Datasheet]:
        """Datasheet numbers (N, Q, B, K, R and those of Gauss-Markov terms), by axis."""
        return self._each(lambda item: item.datasheet)

    @property
    def baselines(self) -> dict[str, Baseline]:
        """Baselines for a monitor (statistics of the innovations in the recording), for the axes that have one."""
        return self.addition("baseline")

    def addition(self, name: str) -> dict[str, Any]:
        """Return what an application has added to the calibration, for the axes that have it.

        Parameters
        ----------
        name : str
            Name of the addition, such as "baseline".
        """
        return {axis: item.additions[name] for axis, item in self.axes.items() if name in item.additions}

    @property
    def rest(self) -> dict[str, BiasAtRest]:
        """Bias at rest, for the axes that were calibrated from samples."""
        return {axis: item.rest for axis, item in self.axes.items() if item.rest is not None}

    @property
    def verdicts(self) -> dict[str, Verdict]:
        """Outlier tests, for the axes that were calibrated from samples."""
        return {axis: item.verdict for axis, item in self.axes.items() if item.verdict is not None}

    @property
    def source_name(self) -> str:
        """The source without folders, for files that users hand on. Together with the SHA-256 it names a recording."""
        return " and ".join(PureWindowsPath(part).name for part in self.source.split(" and "))

    @cached_property
    def remarks(self) -> list[Remark]:
        """All remarks on the recording, the fits and the numbers, the most severe first."""
        from gmwm.calibration.findings import remarks_of

        return remarks_of(self)

    @cached_property
    def verdict(self) -> Remark:
        """Verdict whether the calibration can be used. It is the headline of the summary and of the report."""
        from gmwm.calibration.findings import verdict_of

        return verdict_of(self)

    @cached_property
    def number_verdicts(self) -> dict[str, dict[str, NumberVerdict]]:
        """By axis and symbol: whether the number can be used, used as a bound, or not used, with the reason."""
        from gmwm.calibration.number_verdicts import number_verdicts

        return number_verdicts(self)

    def of_file(self, *paths: str | os.PathLike[str]) -> Calibration:
        """Return the calibration with the name, size and SHA-256 of the files from which the recordings were read.

        Parameters
        ----------
        *paths : path
            Files or folders of the recordings, in the order of the recordings. For a folder, only the name is stored.

        Returns
        -------
        Calibration
            A copy, or this calibration if it has no description of a recording.

        Raises
        ------
        OSError
            If a file cannot be opened.
        """
        if self.recordings:
            descriptions = {
                name: description.of_file(path)
                for (name, description), path in zip(self.recordings.items(), paths, strict=True)
            }
            return replace(self, recordings=descriptions)
        (path,) = paths
        return self if self.recording is None else replace(self, recording=self.recording.of_file(path))

    def combined(self, *others: Calibration) -> Calibration:
        """Combine this calibration with others of the same unit, whose sensors have different clocks or recordings.

        Parameters
        ----------
        *others : Calibration
            Calibrations of other axes of the same unit.

        Returns
        -------
        Calibration
            The calibration of all axes. Its `recordings` describes each recording, by topic or source, and its
            `settings` are those of this calibration.

        Raises
        ------
        DataError
            If two calibrations have an axis in common, or their confidence levels differ.

        Examples
        --------
        >>> import gmwm
        >>> slow = gmwm.simulate({"gyro_x": "WN(sigma2=4e-7)"}, rate=200.0, samples=20_000, rng=1)
        >>> fast = gmwm.simulate({"accel_x": "WN(sigma2=2e-5)"}, rate=250.0, samples=20_000, rng=2)
        >>> gyro, accel = gmwm.calibrate(slow, "WN"), gmwm.calibrate(fast, "WN")
        >>> list(gyro.combined(accel))
        ['gyro_x', 'accel_x']
        """
        from gmwm.calibration.combination import combine

        return combine((self, *others))

    def summary(self, dialect: Dialect = Dialect.PYTHON, *, every: bool = False, details: bool = False) -> str:
        """Return the calibration as text: verdict, one line for each axis, and the most severe remarks.

        Parameters
        ----------
        dialect : Dialect
            Whether options are written as in Python or as in the shell.
        every : bool
            Whether to show all remarks instead of the five most severe.
        details : bool
            Whether to show all numbers of each axis, and why its model was chosen, instead of one line for each axis.
        """
        from gmwm.calibration.summary_text import summary

        return summary(self, dialect, every=every, details=details)

    coordinates = ("axis", "symbol")

    def to_polars(self, units: str = "datasheet") -> DataFrame:
        """Return the datasheet numbers of all axes as a Polars data frame, with one row for each axis and number.

        Parameters
        ----------
        units : "si" or "datasheet"
            Units of the numbers, as in `Datasheet.table`.
        """
        from polars import DataFrame

        rows = [{"axis": axis} | row for axis, sheet in self.datasheets.items() for row in sheet.table(units)]
        return DataFrame(rows, infer_schema_length=None)

    def to_dict(self) -> dict[str, Any]:
        """Return the calibration as dicts, lists, numbers and strings. docs/calibration-format.md describes them."""
        from gmwm.calibration.document import document

        return document(self)

    @staticmethod
    def schema() -> dict[str, Any]:
        """Return the JSON Schema (draft 2020-12) of calibration.json and of `to_dict`, for programs that read them."""
        from gmwm.calibration.document import calibration_schema

        return calibration_schema()

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> Calibration:
        """Restore a calibration from the result of `to_dict`.

        Raises
        ------
        ReadError
            If `content` is not a calibration, is incomplete, or has another version of the format.
        """
        from gmwm.calibration.document import calibration

        return calibration(content)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the calibration to the JSON file `path`, atomically. `load` restores every number exactly."""
        from gmwm.calibration.document import as_text

        write_text(path, as_text(self.to_dict()))

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Calibration:
        """Read a calibration from a file that `save` or `gmwm calibrate` wrote.

        Parameters
        ----------
        path : path
            The JSON file, or the folder with a calibration.json.

        Raises
        ------
        ReadError
            If the file does not exist, is not a calibration, is truncated, or has another version of the format.
        OSError
            If the file exists but cannot be opened.
        """
        from gmwm.calibration.document import read_document

        path = Path(path) / "calibration.json" if Path(path).is_dir() else Path(path)
        if not path.exists():
            raise ReadError(f"{path} does not exist in {path.absolute().parent}", argument="path", got=str(path))
        content = read_document(path, "calibration", AGAIN)
        try:
            return cls.from_dict(content)
        except ReadError as error:
            raise error.at(str(path)) from error

    def export(
        self, path: str | os.PathLike[str] | None = None, format: str = "kalibr", *, axes: Rule | None = None,
        inflation: float = 1.0, horizon: float = 1.0, rate: float | None = None, duration: float | None = None,
    ) -> str:  # fmt: skip
        """Write the noise of the unit in the format of another program.

        Most programs use two numbers of a sensor: the white noise N and the random walk K of the bias. They are those
        of the datasheet: a filter with them predicts the noise best and states the error that it makes (see
        `effective_noise`). If the data cannot distinguish a number from zero, the file has its upper limit, and a
        comment says that it is a limit. Each file begins with the verdict. Below the numbers, it states the units,
        whether the values are for continuous or discrete time, how axes are combined, the inflation, the horizon, what
        is left out, and how well the numbers predict.

        Parameters
        ----------
        path : path, optional
            File to write, atomically. Default: no file is written.
        format : str
            One of `gmwm.exporters.export_formats()`.
        axes : "worst", "mean" or "each", optional
            How to combine the axes of a sensor: use the largest N and the largest K, upper limits included ("worst"),
            the root mean square ("mean"), or one number for each axis ("each") if the format allows it. Default:
            "worst" for filters, and "each" for simulators and messages.
        inflation : float
            Factor on standard deviations and densities. Variances are multiplied by its square.
        horizon : float
            Time (s) over which the filter predicts best.
        rate : float, optional
            Sampling rate (Hz) in the other program. Default: the rate of the recording.
        duration : float, optional
            For programs that model the bias as a Gauss-Markov process: longest averaging time (s) to which this process
            is fitted. Default: one hour, or the duration of the recording if it is shorter.

        Returns
        -------
        str
            The text of the file.

        Raises
        ------
        OptionError
            If an option is unknown or out of range, or does not apply to the format.
        DataError
            If a sensor that the format needs was not calibrated, or the data give no upper limit for a number.
        MissingTheoryError
            If a process in a model lacks the theory that the format needs.

        Examples
        --------
        >>> import gmwm
        >>> truth = {"gyro_x": "WN(sigma2=4e-7) + RW(gamma2=1e-11)", "accel_x": "WN(sigma2=2e-5)"}
        >>> imu = gmwm.simulate(truth, rate=100.0, samples=100_000, rng=1)
        >>> text = gmwm.calibrate(imu, "WN + RW").export(format="kalibr")
        >>> [line for line in text.splitlines() if line.startswith(("gyroscope", "update"))]
        ['gyroscope_noise_density: 6...e-05  # rad/s/sqrt(Hz)', 'gyroscope_random_walk: ...  # rad/s^2/sqrt(Hz)',
         'update_rate: 100.0  # Hz']
        >>> "K of accel_x" in text  # a comment says that it is an upper limit
        True
        """
        from gmwm.showing.exporters import export

        return export(self, path, format, axes=axes, inflation=inflation, horizon=horizon, rate=rate, duration=duration)

    def agree(self, reference: ReferenceLike, *, horizon: float = 1.0) -> ReferenceCheck:
        """Compare the numbers with a reference: a file of another program, or the numbers of a datasheet.

        The numbers of a datasheet are compared with N, K, B, Q and R of the calibration. The numbers in a file are
        compared with N and K for a time horizon, as `export` writes them, and each measured number is also given in the
        convention of the file. To compare calibrations with each other, use `gmwm.agree`.

        Parameters
        ----------
        reference : path, str, Given, or mapping of "gyro.N" or "gyro_x.N" to (value, unit)
            A file that `gmwm.importers.given_noise` reads, text with the numbers of a datasheet, or single numbers.
        horizon : float
            Time horizon (s) of N and K if the reference is a file.

        Returns
        -------
        ReferenceCheck
            Each number with its reference value, their ratio and a verdict.

        Raises
        ------
        OptionError
            If the reference has no number for a calibrated axis, or is neither a file nor numbers.
        ReadError
            If the file has no known keys.
        UnitError
            If the unit of a reference value does not fit the number.

        Examples
        --------
        >>> from gmwm import calibrate, simulate
        >>> imu = simulate({"gyro_x": "WN(sigma2=4e-7)"}, rate=100.0, samples=50_000, rng=1)
        >>> found = calibrate(imu, within="WN + RW").agree({"gyro.N": (0.5, "deg/√h")})
        >>> round(found["gyro_x.N"].ratio, 1), found["gyro_x.N"].verdict
        (0.4, 'larger')
        """
        from gmwm.calibration.reference_check import check_reference

        return check_reference(self, reference, horizon=horizon)

    def budget(
        self, duration: float | str, *, rest: float | str = 60.0, latitude: float = 45.0, level: float = 0.95
    ) -> Budget:
        """Compute how attitude, velocity and position errors of unaided inertial navigation grow.

        `gmwm.navigation.budget` describes the equations and their approximations.

        Parameters
        ----------
        duration : float or str
            Time of navigation (s), or text such as "60s" or "10min".
        rest : float or str
            Time at rest before navigation starts (s), or text such as "60s", which gives the biases and the level.
        latitude : float
            Latitude (deg).
        level : float
            Confidence level of the intervals, from 0.5 to below 1.

        Returns
        -------
        Budget
            The errors over time, each with its confidence interval and the contribution of each term.

        Raises
        ------
        OptionError
            If an option is out of range.
        ModelError
            If an axis is not in rad/s or m/s².
        MissingTheoryError
            If a term has no state-space form.
        """
        from gmwm.applications.navigation.api import budget

        errors = budget(self, duration, rest=rest, latitude=latitude, level=level)
        refused = {one.reason for of_axis in self.number_verdicts.values() for one in of_axis.values() if one.refused}
        wrong = (r for r in self.remarks if r.severity <= Severity.WRONG or r in refused)
        causes = tuple(dict.fromkeys(remark.message.cause for remark in wrong))
        return (
            replace(errors, remarks=(Remark.of("budget-of-wrong", causes=causes), *errors.remarks))
            if causes
            else errors
        )

    def report(self, path: str | os.PathLike[str], *, one_page: bool = False) -> Path:
        """Write the calibration as one self-contained HTML page: verdict, plots, numbers, models, configuration files.

        The page makes no network request, and the same calibration always gives the same bytes.

        Parameters
        ----------
        path : path
            File name that ends in .html, or in .pdf for a printable document. The file is written atomically. A PDF
            needs an installed Chromium, except with `one_page`.
        one_page : bool
            Whether to write only what fits on one page: the verdict, N, B, K and the bias of each axis, one plot, the
            most severe remarks, and the recording with its SHA-256.

        Raises
        ------
        OptionError
            If `path` ends in neither .html nor .pdf, or a PDF cannot be printed.
        OSError
            If the file cannot be written.

        Examples
        --------
        >>> import tempfile, pathlib
        >>> from gmwm import calibrate, simulate
        >>> imu = simulate({"gyro_x": "WN(sigma2=4e-7)"}, rate=100.0, samples=20_000, rng=1)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     written = calibrate(imu, within="WN + RW").report(pathlib.Path(folder, "report.html"))
        ...     written.read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
        True
        """
        from gmwm.showing.reports import report

        return report(self, path, one_page=one_page)

    def __repr__(self) -> str:
        models = ", ".join(f"{axis}: {fit.model.structure}" for axis, fit in self.items())
        failed = f"; failed: {', '.join(self.failed)}" if self.failed else ""
        return f"Calibration({models}{failed})"

    def _each(self, of: Callable[[AxisCalibration], T]) -> dict[str, T]:
        return {axis: of(item) for axis, item in self.axes.items()}
