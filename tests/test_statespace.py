import numpy as np
import pytest

from gmwm.base.errors import ModelError
from gmwm.theory.statespace import StateSpace
from tests.helpers import raises

DT = 0.1
ROTATION = 0.98 * np.array([[np.cos(0.3), np.sin(0.3)], [-np.sin(0.3), np.cos(0.3)]])


def oscillator():
    """A stationary two-state oscillator: FPFᵀ + Q = P with P = I."""
    return StateSpace(ROTATION, (1 - 0.98**2) * np.eye(2), [1.0, 0.5], 0.2, P0=np.eye(2))


def toeplitz(space, n):
    return space.autocovariance(np.subtract.outer(np.arange(n), np.arange(n)).ravel()).reshape(n, n)


def test_blocks_agree_with_the_covariance_matrix():
    space = oscillator()
    matrix = toeplitz(space, 64)
    for m, variance in zip((0, 1, 2, 3, 17, 64), space.block_variance([0, 1, 2, 3, 17, 64]), strict=True):
        assert variance == pytest.approx(matrix[:m, :m].sum(), rel=1e-12)
    for level in (1, 3, 6):
        filter_ = np.repeat([1.0, -1.0], 2 ** (level - 1)) / 2**level
        part = matrix[: 2**level, : 2**level]
        assert space.haar_variance([level])[0] == pytest.approx(filter_ @ part @ filter_, rel=1e-12)


def test_the_spectrum_is_the_transform_of_the_autocovariance():
    space, k = oscillator(), np.arange(-3000, 3001)
    f = np.array([-3.0, 0.0, 0.5, 4.9])
    transform = (space.autocovariance(k) * np.cos(2 * np.pi * np.outer(f * DT, k))).sum(axis=1) * DT
    np.testing.assert_allclose(space.psd(f, 1 / DT), transform, rtol=1e-10)


def test_a_sum_is_block_diagonal():
    a, b = oscillator(), StateSpace(1.0, 2.0, 1.0, P0=3.0, m0=[4.0], diffuse=[True])
    both = a + b
    assert both.states == 3
    np.testing.assert_array_equal(both.F[:2, :2], a.F)
    np.testing.assert_array_equal(both.F[2], [0, 0, 1])
    np.testing.assert_array_equal(both.Q[2], [0, 0, 2])
    np.testing.assert_array_equal(both.H, [[1.0, 0.5, 1.0]])
    np.testing.assert_array_equal(both.m0, [0, 0, 4])
    np.testing.assert_array_equal(both.diffuse, [False, False, True])
    assert both.R[0, 0] == 0.2
    np.testing.assert_allclose(both.haar_variance(8), a.haar_variance(8) + b.haar_variance(8), rtol=1e-12)
    nothing = StateSpace.sum([])
    assert nothing.states == 0
    assert nothing.haar_variance(2).tolist() == [0.0, 0.0]


def test_simulated_paths_have_the_autocovariance():
    space = oscillator()
    paths = space.simulate(40, np.random.default_rng(5), paths=4000)
    for k in (0, 1, 10):
        products = paths[:, 20] * paths[:, 20 + k]
        error = products.std() / np.sqrt(len(paths))
        assert abs(products.mean() - space.autocovariance([k])[0]) <= 4 * error


def test_matrices_are_read_only_and_checked():
    space = oscillator()
    with pytest.raises(ValueError, match="read-only"):
        space.F[0, 0] = 1.0
    with raises(ModelError, "(2, 2)", "H has 2 states", argument="F", got=[[1.0]]):
        StateSpace([[1.0]], np.eye(2), [1.0, 0.0])
    with raises(ModelError, "finite", argument="Q"):
        StateSpace(1.0, np.nan, 1.0)
