"""The tab "Model" fits what `gmwm calibrate` fits, and work that is cancelled ends."""

import time

import numpy as np
import pytest

import gmwm
from gmwm.applications.app.folders import Folders
from gmwm.applications.app.page.model import _tests
from gmwm.applications.app.session import Session
from gmwm.applications.app.workspace import Jobs, Workspace

RATE, SAMPLES = 20.0, 60_000
ENDS = 1.0
"""Longest time (s) from Cancel to the end of the work on a busy machine; without the checks, the fits below need
minutes."""


@pytest.fixture(scope="module")
def workspace(tmp_path_factory):
    """A recording with a warm-up that gyro_x follows."""
    folder = tmp_path_factory.mktemp("recordings")
    truth = {"gyro_x": "WN(sigma2=4e-7) + RW(gamma2=2e-12)", "accel_x": "WN(sigma2=2e-5) + RW(gamma2=1e-9)"}
    imu = gmwm.simulate(truth, rate=RATE, samples=SAMPLES, rng=4)
    heat = 25.0 + 15.0 * -np.expm1(-np.arange(SAMPLES) / (600 * RATE))
    path = folder / "warm.csv"
    time_s = np.arange(SAMPLES) / RATE
    gyro = imu["gyro_x"].values + 1e-3 * (heat - 25)
    columns = np.column_stack([time_s, gyro, imu["accel_x"].values, np.round(heat, 2)])
    np.savetxt(path, columns, delimiter=",", header="time,gyro_x,accel_x,temperature", comments="", fmt="%.9g")
    return Workspace(Folders(folder.resolve(), folder)), Session(
        file=str(path), reading={"units": {"gyro": "rad/s", "accel": "m/s^2"}}
    )


def value(job):
    assert job.join(60)
    assert job.error is None
    return job.value


@pytest.mark.slow
@pytest.mark.parametrize("models", [{}, {"gyro_x": "GM + WN + RW", "accel_x": "WN + FN + RW"}])
def test_the_model_tab_fits_what_calibrate_fits(workspace, models):
    space, session = workspace
    session = session.with_(models=models)
    calibration = value(space.calibration(session))
    assert calibration.axes["gyro_x"].regression.applied
    for axis, fit in calibration.items():
        shown = value(space.fit(session, axis))
        assert shown.model.structure == fit.model.structure
        assert np.array_equal(shown.wavelet_variance.variance, fit.wavelet_variance.variance)
        assert shown.wavelet_variance.model_error == pytest.approx(fit.wavelet_variance.model_error, rel=1e-6)
        assert dict(shown.parameters) == pytest.approx(dict(fit.parameters), rel=1e-6)
        intervals = value(space.intervals(session, axis))
        assert intervals.keys() == calibration.axes[axis].intervals.keys()
        for name, ends in calibration.axes[axis].intervals.items():
            assert intervals[name] == pytest.approx(ends, rel=1e-5)
        (facts,) = (part for part in _tests(shown).children if part.children[0].children == "Goodness of fit")
        assert facts.children[1].children == calibration.axes[axis].test.summary()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::gmwm.errors.FitWarning")
@pytest.mark.parametrize("model", ["MAT + 2*GM + FN", "ARMA(2,1) + 2*GM + RW"])
def test_fits_end_when_they_are_cancelled(model):
    truth, samples = gmwm.Model.parse("WN(sigma2=1e-6) + GM(beta=0.1, sigma2=1e-8) + RW(gamma2=1e-14)"), 2**20
    scatter = np.exp(0.02 * np.random.default_rng(1).standard_normal(18))
    levels = np.arange(1, 19)
    wv = gmwm.WaveletVariance.from_values(truth.wavelet_variance(levels, 100.0) * scatter, samples, 100.0)
    ended = []

    def work(job):
        try:
            while True:
                gmwm.fit(model, wv, weighting="optimal")
        finally:
            ended.append(time.process_time())

    job = Jobs().ask("fit", model, "Fitting", work)
    assert not job.join(0.5)
    asked = time.process_time()
    job.cancel()
    assert job.state == "cancelled"
    while not ended:
        time.sleep(0.01)
    # Of processor time, as a busy machine says nothing of the fit.
    assert ended[0] - asked < ENDS
