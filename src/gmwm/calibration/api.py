"""Calibrate recordings: choose and fit the noise model of every axis, and compute its numbers and their uncertainty."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Literal

from gmwm.calibration.options import SEARCHED, CalibrationOptions
from gmwm.measuring.regression.against import AUTO, Against
from gmwm.theory.processes.model import ModelLike
from gmwm.theory.processes.validation import as_seed

if TYPE_CHECKING:
    import numpy as np
    from distributed import Client

    from gmwm.base.reporting import Progress
    from gmwm.calibration.calibrate_recordings import Data, Several
    from gmwm.calibration.result import Calibration


def calibrate(
    data: Data | Several, within: ModelLike = SEARCHED, *, robust: Literal["auto"] | bool = "auto",
    weighting: Literal["diagonal", "optimal"] = "optimal", criterion: Literal["asymptotic", "bootstrap"] = "asymptotic",
    confidence: float = 0.95, efficiency: float = 0.6, draws: int = 1000, rng: int | np.random.Generator = 0,
    against: Against = AUTO, gravity: float | None = None, tilt: float | None = None,
    warmup: Literal["omit", "keep"] = "omit",
    axes: str | Sequence[str] | None = None, models: Mapping[str, ModelLike] | None = None,
    repeated: Literal["auto", "keep"] = "auto", threads: int | None = None,
    scheduler: str | Client | None = None, workers: int | None = None, progress: Progress | Literal[True] | None = None,
) -> Calibration:  # fmt: skip
    """Calibrate every axis of an inertial sensor: choose a noise model, fit it and compute its datasheet numbers.

    For each axis, the function estimates the wavelet variance, selects a model, fits it, certifies the optimum given
    the filter and the lines taken from the spectrum, and computes confidence intervals, a goodness-of-fit test and the
    numbers of a datasheet. An axis that cannot be calibrated is listed in `failed`; the others are not affected.

    Parameters
    ----------
    data : Imu, Signal, Stream or data frame; a list of these; or mapping of axis to Signal, WaveletVariance or a pair
        A recording of a sensor at rest, or a list (or a mapping of name to Imu or Stream) of several recordings of one
        unit. For several recordings, each axis has one model, which is fitted to the mean of their curves, and the
        intervals include the spread between them; `calibration.axes[axis].replicates` compares the recordings. A Stream
        gives the same result as a recording in memory, but is read in chunks: twice if it has more than 2.1 million
        samples, once more for its temperature, and once more up to 0.5 million samples for the baseline of `Monitor` if
        the effect of a condition is removed. Only for a recording in memory, a remark names axes that share noise (see
        `cross`).
    within : "auto", or Model, Process or str
        With "auto", gmwm searches for the model. It starts with slow noise processes, white noise and quantization
        noise. If the goodness-of-fit test rejects these, it adds what the spectrum shows: the filter of the sensor,
        resonances and lines. Any other value is the largest model; all models made of some of its terms are compared.
    robust : "auto", False or True
        Whether the robust wavelet variance, which outliers hardly affect, is fitted. "auto" uses it for axes on which
        knocks or motion raise the classical curve, at the 5 % level for all axes together (see `contamination`). Heavy
        tails are not outliers: the classical curve is fitted, and its covariance includes the effect of the tails.
        Isolated wrong samples are replaced before any curve is computed. If `within` has a sinusoid, "auto" always uses
        the classical estimate, because the robust estimate of a sinusoid differs from its theory. If the data are a
        WaveletVariance, it is fitted unchanged.
    weighting, criterion, draws, rng
        As in `select`. The settings of the result contain the integer seed; for a Generator, a seed drawn from it.
    confidence : float
        Confidence level of the intervals, and of the set of models that `select` considers equivalent.
    efficiency : float
        Efficiency of the robust wavelet variance under Gaussian noise, relative to the classical one.
    against : "auto", "none", str, (N,) array, or mapping of name to array
        Conditions whose effect is removed before the noise is estimated. "auto" removes the effect of the temperature
        of the recording from each axis that follows it at the 5 % level. A string names the temperature or time with
        options, for example "temperature:2,lag", "time:3" or "warmup". An array or a mapping has other covariates. See
        docs/howto/temperature.md.
    gravity : float, optional
        Local gravity (m/s²), which determines the bias at rest of the accelerometers. Default: 9.806 ± 0.016, the range
        at sea level.
    tilt : float, optional
        Largest possible angle (°) between the vertical and the accelerometer axis closest to it. Without it, only the
        bias of the vertical accelerometer is computed.
    warmup : "omit" or "keep"
        With "omit", the beginning of an Imu or Stream is left out if a warm-up there raises K by more than its
        uncertainty, and if at least half of the recording is left. A remark and the summary say so.
    axes : str or sequence of str, optional
        The axes to calibrate; "gyro" and "accel" mean all axes of a sensor. Default: all axes.
    models : mapping of axis or sensor to Model, Process or str, optional
        Models that are fitted without comparing them with others, such as {"gyro_x": "2*GM + WN", "accel": "WN + RW"}.
        gmwm chooses the models of the other axes.
    repeated : "auto" or "keep"
        With "auto", faults of the logger are undone, as `gmwm.inspect` describes, and motion in at most 15 % of the
        recording is left out. With "keep", all values are used as they are.
    threads : int, optional
        Number of axes that are calibrated at the same time. Default: the number of processors.
    scheduler, workers : optional
        Processes that read a stream in parallel: the address or client of a Dask scheduler, or a number of local
        processes. The fits run in the calling process.
    progress : True, or function of (done, all, text), optional
        True shows a progress bar, also in a notebook. A function is called after each step, and repeatedly while a
        stream is read, by one thread at a time. The logger "gmwm" gets each step at the level INFO.

    Returns
    -------
    Calibration
        A mapping of axis to the recommended Fit, with rankings, datasheets, remarks and a verdict.

    Raises
    ------
    OptionError
        If an argument is not allowed.
    DataError, ModelError
        If no axis can be calibrated, for example because the recording has fewer than 64 samples without a gap and thus
        fewer than four usable scales.

    References
    ----------
    Guerrier, Skaloud, Stebler and Victoria-Feser (2013), Wavelet-variance-based estimation for composite stochastic
    processes, JASA 108, 1021-1030.

    Examples
    --------
    >>> from gmwm import simulate
    >>> imu = simulate({"gyro_x": "WN(sigma2=4e-7) + RW(gamma2=1e-11)"}, rate=100.0, samples=100_000, rng=1)
    >>> calibration = calibrate(imu, within="GM + WN + RW")
    >>> calibration["gyro_x"].model.structure
    'WN + RW'
    """
    options = CalibrationOptions(
        within=within, robust=robust, weighting=weighting, criterion=criterion, confidence=confidence,
        efficiency=efficiency, draws=draws, seed=as_seed(rng), against=against, gravity=gravity, tilt=tilt,
        warmup=warmup, axes=axes,
        models={} if models is None else models,
        repeated=repeated,
    )  # fmt: skip
    from gmwm.base.reporting import reported
    from gmwm.calibration.calibrate_recordings import calibrate_recording

    with reported(progress, "calibrating") as show:
        return calibrate_recording(data, options, threads=threads, scheduler=scheduler, workers=workers, progress=show)
