"""The robust wavelet variance of a real recording: reference values, and the root that the full MAD leads to."""

import json
from pathlib import Path

import numpy as np
import pytest

import gmwm
from gmwm.base import _core
from gmwm.measuring.variance.biweight import NORMAL_QUARTILE, biweight, newton, scan
from gmwm.measuring.variance.coefficients import HaarCoefficients

SHARED = Path(__file__).resolve().parents[3] / "shared"
RECORDING = SHARED / "data" / "adis16405_static_1.parquet"
REFERENCE = SHARED / "reference" / "haar_wv_adis16405_static_1.json"
AXES = ("gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z")
EFFICIENCIES = (0.6, 0.9)

pytestmark = pytest.mark.skipif(
    not (RECORDING.exists() and REFERENCE.exists()), reason="needs the ADIS 16405 recording of ../shared"
)


@pytest.fixture(scope="module")
def recording():
    """The six axes as they were logged, in deg/s and g."""
    import polars

    table = polars.read_parquet(RECORDING)
    names = {axis: next(name for name in table.columns if name.startswith(axis)) for axis in AXES}
    return {axis: table[name].to_numpy().astype(float) for axis, name in names.items()}


@pytest.fixture(scope="module")
def reference():
    return json.loads(REFERENCE.read_text())


@pytest.mark.slow
@pytest.mark.parametrize("axis", AXES)
def test_reference_values(recording, reference, axis):
    for efficiency in EFFICIENCIES:
        wv = gmwm.wavelet_variance(recording[axis], 100.0, robust=True, efficiency=efficiency)
        np.testing.assert_allclose(wv.variance, reference[axis][f"robust_{efficiency}"], rtol=1e-8)
        found = wv.diagnostics["robust"]
        assert set(found["outcome"]) == {"root"}
        assert max(found["passes"]) <= 3
        assert max(found["zeros"]) < 0.5


@pytest.mark.slow
@pytest.mark.parametrize("axis", AXES)
def test_it_is_the_root_that_the_full_median_leads_to(recording, axis):
    x = recording[axis]
    variances = {
        e: gmwm.wavelet_variance(x, 100.0, robust=True, efficiency=e).variance for e in EFFICIENCIES
    }  # fmt: skip
    source = HaarCoefficients(x, 19)
    for k in range(19):
        w = source.sample(k, x.size)
        start = (float(np.median(w)) / NORMAL_QUARTILE) ** 2
        assert start > 0
        for efficiency, variance in variances.items():
            tuning = biweight(efficiency)

            def criterion(place, tuning=tuning, w=w, start=start):
                cubed, fourth = _core.biweight_sums(w, tuning.c**2 * start * np.exp(place))
                return tuning.criterion(cubed, fourth, float(w.size))

            root, _ = newton(criterion, 1e-12)
            if root is None:
                root = scan(criterion, 1e-12).root
            assert root is not None
            assert variance[k] == pytest.approx(start * np.exp(root), rel=1e-9), (k + 1, efficiency)
