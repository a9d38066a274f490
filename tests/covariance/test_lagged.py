"""The covariance of moments at lags against dense matrices."""

from __future__ import annotations

import numpy as np
import pytest
from gmwm.errors import MissingTheoryError
from gmwm.filters import find_filter
from gmwm.processes import Model

from gmwm.measuring.covariance import Design, covariance, variances
from gmwm.measuring.variance.api import variances_alone
from tests.helpers import each

FILTER = find_filter("haar + lags:1,3,4")
LENGTHS = ((40,), (23, 3, 17, 6))
MODELS = (
    "WN(sigma2=2)", "MA(2, theta1=0.6, theta2=0.3, sigma2=1)", "AR(2, phi1=1.4, phi2=-0.6, sigma2=1)",
    "AR1(phi=-0.8, sigma2=1) + WN(sigma2=0.1)", "GM(beta=0.02, sigma2=1) + WN(sigma2=1)",
    "RW(gamma2=1) + WN(sigma2=3)", "DR(omega=0.5) + WN(sigma2=1)", "QN(q2=1) + WN(sigma2=0.1)", "FN(b2=1)",
)  # fmt: skip


def coefficient_rows(level: int, samples: int) -> np.ndarray:
    """The coefficients of a moment as rows of a matrix (M, N) that multiplies the samples."""
    if level > 0:
        h = 2 ** (level - 1)
        taps = np.concatenate([np.full(h, 0.5 / h), np.full(h, -0.5 / h)])
    else:
        taps = np.zeros(2 - level)
        taps[:2] += [0.5, -0.5]
        taps[-2:] += [0.5, -0.5]
        taps /= np.sqrt(2.0)
    count = samples - taps.size + 1
    rows = np.zeros((max(count, 0), samples))
    for k in range(count):
        rows[k, k : k + taps.size] = taps[::-1]
    return rows


@each("lengths", LENGTHS)
@each("text", MODELS)
def test_the_covariance_is_that_of_quadratic_forms(text, lengths):
    model = Model.parse(text)
    levels = FILTER.numbers(max(lengths).bit_length() - 1)
    total = np.zeros((levels.size, levels.size))
    counts = np.zeros(levels.size)
    means = np.zeros(levels.size)
    for n in lengths:
        m = np.arange(n)
        known = sum(p.generalised_covariance(m, 1.0) for p in model.processes)
        sigma = known[np.abs(m[:, None] - m)]
        drift = sum(p.mean(m) for p in model.processes)
        rows = [coefficient_rows(int(level), n) for level in levels]
        squares = [g.T @ g for g in rows]
        cumulant = sum(p.error_cumulant for p in model.processes)
        errors = np.diff(np.eye(n + 1), axis=0)
        for a, qa in enumerate(squares):
            counts[a] += len(rows[a])
            means[a] += np.trace(qa @ sigma) + drift @ qa @ drift
            for b, qb in enumerate(squares):
                total[a, b] += 2 * np.trace(qa @ sigma @ qb @ sigma) + 4 * drift @ qa @ sigma @ qb @ drift
                if cumulant:
                    of_a, of_b = (np.diag(errors.T @ q @ errors) for q in (qa, qb))
                    total[a, b] += cumulant * of_a @ of_b
    design = Design(
        levels=levels, samples=sum(lengths), rate=1.0, filter=FILTER, segments=lengths if len(lengths) > 1 else ()
    )
    assert design.counts.tolist() == counts.tolist()
    v = covariance(model, design)
    scale = np.sqrt(np.diag(v))
    assert np.max(np.abs(v - total / np.outer(counts, counts)) / np.outer(scale, scale)) < 1e-7
    assert np.array_equal(variances(model, design), np.diag(v))
    assert model.wavelet_variance(levels, 1.0, FILTER) == pytest.approx(means / counts, rel=1e-9)


@pytest.mark.parametrize("text", [*MODELS, "SIN(frequency=0.1, power=1)", "MAT(beta=0.3, nu=0.8, sigma2=1)"])
def test_the_jacobian_agrees_with_differences(text):
    model = Model.parse(text)
    levels = FILTER.numbers(5)
    jacobian = model.jacobian(levels, 1.0, FILTER)
    for column, name in zip(jacobian.T, model.names, strict=True):
        value = model.parameters[name]
        step = 1e-5 * value
        high, low = (model.with_values({name: value + s}).wavelet_variance(levels, 1.0, FILTER) for s in (step, -step))
        assert column == pytest.approx((high - low) / (2 * step), rel=1e-6, abs=1e-6 * np.abs(column).max())


def test_moments_of_slow_processes_have_all_digits():
    levels = FILTER.numbers(3)
    slow = Model.parse("GM(beta=1e-12, sigma2=1e12)").wavelet_variance(levels, 1.0, FILTER)
    assert slow == pytest.approx(Model.parse("RW(gamma2=2)").wavelet_variance(levels, 1.0, FILTER), rel=1e-9)


def test_moments_of_segments_are_pooled_over_all_pairs():
    rng = np.random.default_rng(1)
    segments = [rng.standard_normal(n) for n in LENGTHS[1]]
    moments = variances_alone(segments, FILTER, "modwt", 4, None)
    for level, moment in zip(FILTER.numbers(4), moments, strict=True):
        every = np.concatenate([coefficient_rows(int(level), x.size) @ x for x in segments])
        assert moment == pytest.approx(np.mean(every**2))


def test_a_sinusoid_has_no_covariance_with_lags():
    model = Model.parse("WN(sigma2=1) + SIN(frequency=0.1, power=1)")
    with pytest.raises(MissingTheoryError, match="SIN"):
        covariance(model, Design(levels=FILTER.numbers(3), samples=100, rate=1.0, filter=FILTER))
