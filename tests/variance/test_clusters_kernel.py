import numpy as np
import pytest

from gmwm.base import _core
from tests.oracles import allan as oracle


def phase(size, integrals=1):
    x = np.random.default_rng(size).normal(size=size)
    for _ in range(integrals):
        x = np.cumsum(x)
    return x - np.linspace(x[0], x[-1], size)


@pytest.mark.parametrize("integrals", [0, 1, 2])
@pytest.mark.parametrize("size", [9, 64, 301, 2050])
def test_kernels_are_their_definitions(size, integrals):
    p = phase(size, integrals)
    for n in sorted({1, 2, 3, 5, 17, size // 7, size // 3, size // 2, size - 2}):
        if 1 <= n <= (size - 1) // 2:
            for stride in (1, n):
                count = len(range(0, size - 2 * n, stride))
                got = _core.second_differences(p, n, stride) / count / (2 * n**2)
                assert got == pytest.approx(float(oracle.allan(p, n, stride)), rel=1e-10)
        if 1 <= n <= (size - 1) // 3:
            for stride in (1, n):
                count = len(range(0, size - 3 * n, stride))
                got = _core.third_differences(p, n, stride) / count / (6 * n**2)
                assert got == pytest.approx(float(oracle.hadamard(p, n, stride)), rel=1e-10)
        if 1 <= n <= size // 3:
            got = _core.moving_second_differences(p, n) / (size - 3 * n + 1) / (2 * n**4)
            assert got == pytest.approx(float(oracle.modified(p, n)), rel=1e-10)
        if 1 <= n <= size - 2:
            got = _core.reflected_second_differences(p, n) / (size - 2) / (2 * n**2)
            assert got == pytest.approx(float(oracle.total(p, n)), rel=1e-10)


@pytest.mark.parametrize(
    ("kernel", "most"),
    [
        (_core.second_differences, 14),
        (_core.third_differences, 9),
        (_core.moving_second_differences, 10),
        (_core.reflected_second_differences, 28),
    ],
)
def test_clusters_that_do_not_exist(kernel, most):
    p = phase(30)
    assert kernel(p, most) > 0
    for n in (0, most + 1, 2**62, 2**63):
        with pytest.raises(ValueError, match=rf"^n .* {most}\b"):
            kernel(p, n)
    with pytest.raises(ValueError, match=r"^n .* 0\b"):
        kernel(np.empty(0), 1)
    for wrong in ([1.0, 2.0, 3.0, 4.0], np.arange(30), np.arange(60.0)[::2]):
        with pytest.raises(TypeError):
            kernel(wrong, 1)


def test_a_stride_of_zero():
    with pytest.raises(ValueError, match=r"^stride "):
        _core.second_differences(phase(30), 1, 0)


@pytest.mark.parametrize("size", [2, 9, 4096, 10_000])
def test_octaves_in_one_pass_are_the_octaves_one_by_one(size):
    x = np.random.default_rng(size).normal(size=size) + 100.0
    octaves = size.bit_length() - 1
    p, sums = _core.octave_second_differences(x, octaves)
    np.testing.assert_allclose(p, _core.running_sum(x), atol=1e-9)
    np.testing.assert_allclose(sums, [_core.second_differences(p, 2**j) for j in range(octaves)], rtol=1e-12)


@pytest.mark.parametrize("octaves", [0, 4, 63, 64, 2**40])
def test_octaves_that_do_not_exist(octaves):
    with pytest.raises(ValueError, match=r"^octaves "):
        _core.octave_second_differences(phase(15), octaves)


def test_a_value_that_is_not_finite_shows_in_the_phase():
    x = phase(100)
    x[60] = np.nan
    p, sums = _core.octave_second_differences(x, 6)
    assert np.all(np.isnan(p[1:]))
    assert np.all(np.isnan(sums))
