"""The filter and the lines from the spectrum are held in the fit. A joint step in which they move within their errors
would hardly change N and K."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import butter, lfilter

import gmwm
from gmwm.choosing.datasheets.filter_numbers import filter_numbers
from gmwm.fitting.estimation.linearised import columns_of, relative_jacobian
from gmwm.measuring.covariance import Design, covariance

pytestmark = pytest.mark.slow


def after_joint_step(fit):
    """Return the processes after a Gauss-Newton step of the parameters and the filter, whose deviations have the excess
    covariance from the spectrum."""
    wv = fit.wavelet_variance
    design = Design.of(wv)
    columns, _ = columns_of(fit.model, fit.diagnostics.acts_as)
    free = [name for name in fit.model.names if name not in fit.model.fixed_names]
    root = np.linalg.inv(np.linalg.cholesky(covariance(fit.model, replace(design, excess=None))))
    square, axes = np.linalg.eigh(wv.excess * np.outer(fit.implied, fit.implied))
    shape = axes * np.sqrt(np.maximum(square, 0.0))
    slopes = relative_jacobian(fit.model, design, columns)
    count = slopes.shape[1]
    matrix = np.block([[root @ slopes, root @ shape], [np.zeros((len(wv), count)), np.eye(len(wv))]])
    target = np.concatenate([root @ (wv.variance - fit.implied), np.zeros(len(wv))])
    step = dict(zip(free, np.linalg.lstsq(matrix, target, rcond=None)[0][:count], strict=True))
    processes = []
    for term, process in zip(fit.model.terms, fit.model.processes, strict=True):
        names = {p.name: f"{term}.{p.name}" for p in process.parameters}
        values = {p: fit.parameters[name] * np.exp(step[name]) for p, name in names.items() if name in step}
        processes.append(process.with_values(**values))
    return processes


@pytest.mark.parametrize("seed", [1, 2])
def test_a_joint_step_hardly_changes_n_and_k(seed):
    rng = np.random.default_rng(seed)
    rate, samples = 100.0, 200_000
    white = lfilter(*butter(2, 0.2), 6.3e-4 * rng.standard_normal(samples))
    walk = np.cumsum(2e-6 * rng.standard_normal(samples))
    line = 1e-4 * np.sin(2 * np.pi * 7.3 * np.arange(samples) / rate)
    axis = gmwm.calibrate(gmwm.Signal(white + walk + line, rate, "rad/s", "gyro_x")).axes["gyro_x"]
    assert axis.fit.model.fixed_names
    assert axis.fit.wavelet_variance.excess is not None
    before = filter_numbers(axis.fit.model.processes, rate)
    after = filter_numbers(after_joint_step(axis.fit), rate)
    # On 18 axes of an ADIS16405: at most 0.13 and 0.18 of half the interval.
    for symbol in "NK":
        entry = axis.datasheet[symbol]
        half = np.log(entry.high / entry.low) / 2
        assert abs(np.log(getattr(after, symbol) / getattr(before, symbol))) < 0.2 * half
