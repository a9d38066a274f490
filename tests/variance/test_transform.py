"""MODWT and DWT: inverses, energy, linearity, shifts, boundaries, and agreement with PyWavelets."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gmwm.base.errors import DataError, OptionError
from gmwm.measuring.variance.transform import dwt, modwt
from gmwm.recording.signals import Signal
from gmwm.theory.filters import FILTERS, find_filter
from tests.helpers import each, raises

pywt = pytest.importorskip("pywt")
every_filter = pytest.mark.parametrize("name", [*FILTERS, "sym5", "db9"])
loop_over_filter = each("name", [*FILTERS, "sym5", "db9"])
deterministic = settings(derandomize=True, deadline=None, max_examples=8, database=None)
boundaries = pytest.mark.parametrize("boundary", ["periodic", "reflection"])
loop_over_boundaries = each("boundary", ["periodic", "reflection"])
both = pytest.mark.parametrize("transform", [modwt, dwt])


def white(n, seed=0):
    return np.random.default_rng([seed, n]).standard_normal(n)


def energy(transformed):
    parts = [
        *transformed.details.values(),
        transformed.smooth,
        np.array(list(getattr(transformed, "extras", {0: 0.0}).values())),
    ]
    return sum(float(part @ part) for part in parts)


@pytest.mark.slow
@both
@boundaries
@every_filter
@deterministic
@given(n=st.integers(2, 600), power=st.integers(-12, 12))
def test_the_inverse_recovers_the_signal_and_energy_is_preserved(transform, boundary, name, n, power):
    x = (white(n) + 3.0) * 10.0**power
    transformed = transform(x, name, boundary=boundary)
    np.testing.assert_allclose(transformed.inverse(), x, rtol=0, atol=1e-12 * np.abs(x).max())
    copies = 2 if boundary == "reflection" else 1
    assert energy(transformed) == pytest.approx(copies * float(x @ x), rel=1e-12)


@pytest.mark.slow
@both
@every_filter
@deterministic
@given(n=st.integers(2, 300), a=st.floats(-5, 5), b=st.floats(-5, 5))
def test_transforms_are_linear(transform, name, n, a, b):
    x, y = white(n, 1), white(n, 2)
    left, one, other = (transform(v, name) for v in (a * x + b * y, x, y))
    for j in left.details:
        np.testing.assert_allclose(left.details[j], a * one.details[j] + b * other.details[j], atol=1e-13)
    np.testing.assert_allclose(left.smooth, a * one.smooth + b * other.smooth, atol=1e-12)


@pytest.mark.slow
@every_filter
@deterministic
@given(n=st.integers(2, 300), shift=st.integers(0, 400))
def test_a_shifted_signal_has_shifted_coefficients(name, n, shift):
    x = white(n)
    one, other = modwt(x, name), modwt(np.roll(x, shift), name)
    for j in one.details:
        np.testing.assert_allclose(np.roll(one.details[j], shift), other.details[j], atol=1e-13)


@pytest.mark.slow
@loop_over_boundaries
@each("n", [50, 257, 600])
@loop_over_filter
def test_interior_coefficients_are_those_of_the_level_filter(name, n, boundary):
    f, x = find_filter(name), white(n)
    maximal, decimated = modwt(x, name, boundary=boundary), dwt(x, name, boundary=boundary)
    seen = 0
    for j in maximal.details:
        if f.width(j) > n:
            assert maximal.interior[j].start == maximal.interior[j].stop
            assert decimated.interior[j].start == decimated.interior[j].stop
            continue
        exact = np.convolve(x, f.level_filter(j), "valid")
        np.testing.assert_allclose(maximal.details[j][maximal.interior[j]], exact, atol=1e-13)
        ends = np.arange(f.width(j) - 1, n)
        at = (ends + 1) % 2**j == 0
        scaled = 2 ** (j / 2) * exact[at]
        np.testing.assert_allclose(decimated.details[j][decimated.interior[j]], scaled, atol=1e-12)
        seen += 1
    assert seen > 0


@each("n", [50, 257])
@loop_over_filter
def test_coefficients_outside_the_interior_feel_the_other_end(name, n):
    # A change beyond the last sample that an interior coefficient is made of moves no interior coefficient.
    f, x = find_filter(name), white(n)
    for transform in (modwt, dwt):
        one, other = transform(x, name), transform(x, name, boundary="reflection")
        for j in one.details:
            inside = one.interior[j]
            np.testing.assert_allclose(one.details[j][inside], other.details[j][inside], atol=1e-13)
            if transform is modwt and f.length > 2:
                assert np.any(np.abs(one.details[j] - other.details[j][:n]) > 1e-6)


@pytest.mark.parametrize("name", ["haar", "db2", "sym4", "sym5", "coif2", "db9"])
def test_modwt_is_the_stationary_transform_of_pywavelets(name):
    # Theirs is centred on its filter, without the factor 2^(−j/2), and the wavelet has the other sign.
    n, level, f = 256, 4, find_filter(name)
    x = white(n)
    theirs = pywt.swt(x, name, level=level, trim_approx=True)
    ours = modwt(x, name, levels=level)
    for j in range(1, level + 1):
        centred = -np.roll(ours.details[j], -(f.length // 2) * (2**j - 1)) * 2 ** (j / 2)
        np.testing.assert_allclose(centred, theirs[level + 1 - j], atol=1e-9)


@each("n", [256, 96, 30])
@each("name", ["haar", "db2", "sym4", "sym5", "coif2", "db9"])
def test_dwt_is_the_periodised_transform_of_pywavelets(name, n):
    # Theirs is centred: coefficient n is made of V_{2n + L/2 − l}; where L/2 is even that is our transform of the
    # signal one sample later. The wavelet has the other sign.
    f, values = find_filter(name), white(n)
    while values.size % 2 == 0:
        smooth, detail = pywt.dwt(values, name, mode="periodization")
        ours = dwt(np.roll(values, (f.length // 2 + 1) % 2), name, levels=1)
        shift = -(f.length // 4)
        np.testing.assert_allclose(np.roll(ours.smooth, shift), smooth, atol=1e-10)
        np.testing.assert_allclose(-np.roll(ours.details[1], shift), detail, atol=1e-10)
        values = smooth


def test_haar_pyramid_is_that_of_pywavelets():
    x = white(96)
    smooth, *details = pywt.wavedec(x, "haar", mode="periodization", level=5)
    ours = dwt(x, "haar", levels=5)
    np.testing.assert_allclose(ours.smooth, smooth, atol=1e-13)
    for j, detail in zip((5, 4, 3, 2, 1), details, strict=True):
        np.testing.assert_allclose(-ours.details[j], detail, atol=1e-13)


def test_odd_lengths_set_a_coefficient_aside():
    x = white(13)
    transformed = dwt(x, "d4", levels=3)
    assert [transformed.details[j].size for j in (1, 2, 3)] == [6, 3, 1]
    assert sorted(transformed.extras) == [1, 3]
    assert transformed.extras[1] == x[-1]
    assert dwt(white(16), "la8").extras == {}


def test_results_are_frozen_and_say_what_they_are():
    for transformed in (modwt(white(20), "la8", 2), dwt(white(20), "la8", 2)):
        assert transformed.levels == 2
        assert "la8, 2 levels, 20 samples, periodic" in repr(transformed)
        for values in (transformed.details[1], transformed.smooth):
            with pytest.raises(ValueError, match="read-only"):
                values[0] = 0.0


@both
def test_bad_arguments_are_named(transform):
    x = white(16)
    for arguments, name in [
        ({"levels": 5}, "levels"),
        ({"levels": True}, "levels"),
        ({"levels": 0}, "levels"),
        ({"boundary": "zero"}, "boundary"),
        ({"filter": "nope"}, "filter"),
    ]:
        with raises(OptionError, argument=name):
            transform(x, **arguments)
    with raises(DataError, "finite", argument="x"):
        transform([1.0, np.nan, 2.0])
    with raises(DataError, "at least 2 values", argument="x"):
        transform([1.0])


@both
def test_a_signal_is_taken_and_one_with_gaps_is_not(transform):
    x = white(64)
    np.testing.assert_array_equal(transform(Signal(x, 100.0)).smooth, transform(x).smooth)
    with raises(DataError, "gaps"):
        transform(Signal(x, 100.0, segments=((0, 30), (30, 64))))
