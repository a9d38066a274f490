"""Real recordings, read in place."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gmwm.base.errors import InferredUnitWarning
from gmwm.files.readers import read
from gmwm.measuring.inspection import inspect
from tests.helpers import codes

DATA = Path(__file__).parents[2].parent / "shared" / "data"
UNITS = {"gyro": "deg/s", "accel": "g"}

pytestmark = pytest.mark.skipif(not DATA.exists(), reason="the recordings of shared/data are not here")


@pytest.mark.slow
def test_the_same_recording_as_parquet_and_as_text():
    whole = read(DATA / "adis16405_static_1.parquet", rate=100, units=UNITS)
    with pytest.warns(InferredUnitWarning) as warned:
        part = read(DATA / "adis16405_static_1_first_1000s.csv", units={"gyro": "deg/s"})
    facts = warned[0].message.remark.facts
    assert (facts["unit"], facts["norm"]) == ("g", pytest.approx(1.017, abs=5e-4))
    assert (len(whole), len(part), part.rate) == (1_000_000, 100_000, 100.0)
    for axis in whole:
        np.testing.assert_array_equal(part[axis].values, whole[axis].values[:100_000])


@pytest.mark.slow
@pytest.mark.parametrize("number", [1, 3])
def test_inspection_of_a_coarse_static_recording(number):
    found = inspect(read(DATA / f"adis16405_static_{number}.parquet", rate=100, units=UNITS))
    assert found.static
    assert not {"unit-doubtful:gravity", "unit-doubtful:density", "unit-contradicted:declared"} & set(
        codes(found.remarks)
    )
    assert found.gravity == pytest.approx(9.97, abs=0.05)
    for axis, step in (("gyro_x", np.radians(0.05)), ("accel_y", 0.00333 * 9.80665)):
        assert found.axes[axis].lsb == pytest.approx(step, rel=1e-6)
