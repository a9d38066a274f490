"""The kernels that make paths of noise, against SciPy and NumPy."""

import numpy as np
import pytest
from scipy.signal import lfilter

from gmwm.base import _core
from tests.helpers import each

SHAPES = [(1, 1), (1, 500), (3, 2), (4, 100), (11, 33), (0, 5)]


@each("shape", SHAPES)
@each("phi", [0.0, 0.9, -0.9, 1.0 - 1e-9])
def test_autoregress(shape, phi):
    noise = np.random.default_rng(1).standard_normal(shape)
    first, rest = 7.0, 0.3
    path = noise.copy()
    _core.autoregress(path, phi, first, rest)
    scaled = noise * rest
    scaled[:, :1] = noise[:, :1] * first
    if noise.size:
        # Bit by bit: a seed gives the same path on every processor.
        assert np.array_equal(path, lfilter([1.0], [1.0, -phi], scaled, axis=-1))


@pytest.mark.parametrize("shape", SHAPES)
def test_accumulate(shape):
    noise = np.random.default_rng(1).standard_normal(shape)
    path = noise.copy()
    _core.accumulate(path, 0.3)
    assert np.array_equal(path, 0.3 * np.cumsum(noise, axis=-1))


@each("shape", SHAPES)
@each("p", [0, 1, 2, 4, 5])
@each("q", [0, 1, 3])
def test_mix(shape, p, q):
    rng = np.random.default_rng(2)
    noise, phi, theta = rng.standard_normal(shape), 0.2 * rng.standard_normal(p), rng.standard_normal(q)
    # Predictors that are those of the recursion itself: then it starts from zero, as SciPy's does.
    predictors = np.tril(np.tile(phi, (p, 1)), -1) if p else np.empty((0, 0))
    path = noise.copy()
    _core.mix(path, phi, theta, predictors, np.full(p, 0.3), 0.3)
    if not noise.size:
        assert path.shape == shape
        return
    expected = lfilter(np.concatenate([[1.0], theta]), np.concatenate([[1.0], -phi]), 0.3 * noise, axis=-1)
    np.testing.assert_allclose(path[:, q:], expected[:, q:], rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("wrong", [np.ones((2, 3), order="F"), np.ones((2, 3), dtype=np.float32), np.ones(3)], ids=str)
def test_only_rows_of_doubles_are_taken(wrong):
    with pytest.raises(TypeError):
        _core.accumulate(wrong, 1.0)
    with pytest.raises(TypeError):
        _core.autoregress(wrong, 0.5, 1.0, 1.0)


def test_no_columns_are_refused():
    with pytest.raises(ValueError, match="column"):
        _core.accumulate(np.ones((2, 0)), 1.0)


def test_predictors_of_another_size_are_refused():
    with pytest.raises(ValueError, match=r"^predictors and deviations "):
        _core.mix(np.ones((1, 3)), np.ones(2), np.ones(0), np.ones((2, 1)), np.ones(2), 1.0)
