"""A calibration reports axes that share noise, and its files say that they treat them as independent."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

import gmwm
from gmwm.applications.several.cross import SharedNoiseAddition, block_means, shared_noise
from gmwm.applications.several.result import SharedNoise
from gmwm.base.remarks import texts
from gmwm.calibration import Calibration
from gmwm.calibration.passes import clean, read_recording
from gmwm.recording.signals import Imu, Signal
from gmwm.showing.exporters import export_formats
from gmwm.showing.exporters.text import plain
from tests.helpers import code_of, only

AXES = ("gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z")
RATE, SAMPLES = 100.0, 20_000


def arrays(rng, share=0.0, axes=AXES):
    """White noise and a random walk; the first two axes share white noise."""
    x = {axis: rng.normal(size=SAMPLES) + 0.01 * np.cumsum(rng.normal(size=SAMPLES)) for axis in axes}
    common = share * rng.normal(size=SAMPLES)
    return {axis: 1e-3 * (values + (common if k < 2 else 0.0)) for k, (axis, values) in enumerate(x.items())}


def signals(values, **more):
    return {axis: Signal(x, RATE, "rad/s" if "gyro" in axis else "m/s²", axis, **more) for axis, x in values.items()}


def codes(calibration):
    return [code_of(remark) for remark in calibration.recording_remarks]


@pytest.fixture(scope="module")
def shared():
    return gmwm.calibrate(Imu(signals(arrays(np.random.default_rng(1), share=0.5))), within="WN + RW")


@pytest.mark.slow
def test_one_remark_names_the_pairs(shared):
    facts = only(shared.recording_remarks, "noise-shared:calibration").facts
    assert facts["pairs"] == ("gyro_x/gyro_y",)
    # The shared share of the white noise is 0.25/1.25; its largest estimate is not far from it at a well-known scale.
    assert 0.1 < facts["correlation"] < 0.9
    restored = Calibration.from_dict(shared.to_dict())
    assert only(restored.recording_remarks, "noise-shared:calibration") == only(
        shared.recording_remarks, "noise-shared:calibration"
    )


@pytest.mark.slow
def test_every_file_says_that_the_axes_are_independent(shared):
    # The comments of AirSim's file, for a simulator, are full: they say first that the numbers must not be used.
    for name in set(export_formats()) - {"airsim"}:
        joined = " ".join(plain(shared.export(format=name)).replace("#", " ").replace('", "', " ").split())
        for mark in (" // ", " % ", " ; "):
            joined = joined.replace(mark, " ")
        assert "The axes share noise (gyro_x/gyro_y); this file treats them as independent." in joined, name


@pytest.mark.slow
def test_a_stream_and_independent_axes_have_no_remark(tmp_path):
    own = arrays(np.random.default_rng(2), axes=AXES[:2])
    assert "noise-shared:calibration" not in codes(gmwm.calibrate(Imu(signals(own)), within="WN + RW"))
    both = arrays(np.random.default_rng(2), share=0.5, axes=AXES[:2])
    Imu(signals(both)).write(tmp_path / "both.csv")
    read = gmwm.calibrate(gmwm.read(tmp_path / "both.csv"), within="WN + RW")
    assert "noise-shared:calibration" in codes(read)
    assert "noise-shared:calibration" not in codes(gmwm.calibrate(gmwm.stream(tmp_path / "both.csv"), within="WN + RW"))


@pytest.mark.slow
def test_knocks_and_temperature_of_all_axes_are_no_shared_noise():
    own = arrays(np.random.default_rng(4), axes=AXES[:3])
    knock, course = np.zeros(SAMPLES), 25 + 5 * np.sin(np.arange(SAMPLES) / 2e3)
    for at in (3_000, 9_000, 15_000):
        knock[at : at + 60] = 0.2 * np.random.default_rng(at).normal(size=60)
    raw = signals({axis: x + knock + 2e-3 * course for axis, x in own.items()})
    assert shared_noise(raw)
    assert "noise-shared:calibration" not in codes(gmwm.calibrate(Imu(raw, temperature=course), within="WN + RW"))


@pytest.mark.slow
def test_each_of_several_recordings_is_tested():
    parts = {
        "monday": Imu(signals(arrays(np.random.default_rng(4), axes=AXES[:2]))),
        "tuesday": Imu(signals(arrays(np.random.default_rng(5), share=0.5, axes=AXES[:2]))),
    }
    found = gmwm.calibrate(parts, within="WN + RW")
    assert only(found.recording_remarks, "noise-shared:calibration").subject == "tuesday"


@pytest.mark.slow
@pytest.mark.parametrize("restarted", [("gyro_x",), AXES[:3]])
def test_gaps_are_filled_once_also_if_one_sensor_restarts(restarted):
    rng = np.random.default_rng(11)
    lost = rng.choice(np.arange(100, SAMPLES - 100), 200, replace=False)
    lost = np.union1d(lost, np.arange(SAMPLES // 2, SAMPLES // 2 + 20))
    recording = {}
    for axis, values in arrays(rng, share=0.5).items():
        values[SAMPLES // 2 :] += 0.02 * (axis in restarted)
        values[lost] = np.nan
        unit = "rad/s" if "gyro" in axis else "m/s²"
        recording[axis] = Signal.from_missing(values, RATE, unit, axis)
    (finding,) = read_recording(Imu(recording), AXES, 0.6).findings
    expected = shared_noise({axis: clean(signal) for axis, signal in recording.items()})
    assert expected
    assert finding == expected


def test_all_samples_give_the_result_of_cross():
    values = arrays(np.random.default_rng(6), share=0.3, axes=AXES[:3])
    at = np.arange(SAMPLES) - (SAMPLES - 1) / 2
    level = {axis: x - np.polyval(np.polyfit(at, x, 1), at) for axis, x in values.items()}
    own, expected = shared_noise(signals(values)), gmwm.cross(signals(level)).shared
    assert [(one.axes, one.level) for one in own] == [(one.axes, one.level) for one in expected]
    np.testing.assert_allclose([one.correlation for one in own], [one.correlation for one in expected], rtol=1e-8)


@pytest.mark.parametrize("segments", [(), [(0, 7_001), (7_001, SAMPLES)]])
def test_block_means_find_the_same_scales(monkeypatch, segments):
    more = {"segments": segments, "gaps_known": False} if segments else {}
    values = signals(arrays(np.random.default_rng(7), share=1.0, axes=AXES[:2]), **more)
    whole = {one.level: one for one in shared_noise(values)}
    monkeypatch.setitem(shared_noise.__globals__, "MOST_BLOCK_MEANS", 1 << 13)
    blocks = {one.level: one for one in shared_noise(values)}
    assert min(blocks) == 3  # blocks of four samples
    assert {3, 4, 5, 6} <= whole.keys() & blocks.keys()
    for level in (3, 4, 5, 6):
        assert whole[level].tau == blocks[level].tau
        assert abs(whole[level].correlation - blocks[level].correlation) < 0.1


def test_changes_of_the_mean_at_a_gap_are_no_shared_noise():
    values = arrays(np.random.default_rng(8), axes=AXES[:3])
    for x in values.values():
        x[8_000:] += 20 * np.std(x)
    assert not shared_noise(signals(values, segments=[(0, 8_000), (8_000, SAMPLES)], starts=[0.0, 86_400.0]))


def test_block_means_by_hand():
    signal = Signal(np.arange(100.0), RATE, "rad/s", "gyro_x", segments=[(0, 41), (41, 48), (48, 100)])
    found = block_means(signal, 2)
    assert found.segments == ((0, 10), (10, 23))
    assert found.rate == RATE / 4
    np.testing.assert_allclose(found.values[[0, 9, 10, 22]], [1.5, 37.5, 49.5, 97.5])


def test_short_and_constant_axes_are_left_out():
    rng = np.random.default_rng(8)
    short = {axis: rng.normal(size=5) for axis in AXES[:2]}
    assert shared_noise(signals(short)) == ()
    values = arrays(rng, share=0.5, axes=AXES[:3])
    values["gyro_z"] = np.zeros(SAMPLES)
    assert {one.axes for one in shared_noise(signals(values))} == {("gyro_x", "gyro_y")}


@pytest.mark.slow
@pytest.mark.parametrize("most", [1 << 20, 1 << 13])
def test_false_alarms_of_independent_axes(monkeypatch, most):
    """The mean number of alarms in 40 recordings at 5 % is 2; with 8 or more, p = 0.001. Trends are independent."""
    monkeypatch.setitem(shared_noise.__globals__, "MOST_BLOCK_MEANS", most)
    rng, alarms = np.random.default_rng(9), 0
    for _ in range(40):
        own = {a: x + 1e-2 * rng.normal() * np.linspace(0, 1, SAMPLES) for a, x in arrays(rng).items()}
        alarms += bool(shared_noise(signals(own)))
    assert alarms < 8


def test_many_pairs_are_counted_and_the_strongest_named():
    def one(first, second, r):
        return SharedNoise(
            axes=(first, second), level=3, tau=0.08, correlation=r, lower=0.0, upper=1.0, pvalue=1e-9
        )  # fmt: skip

    names = list(combinations(AXES, 2))
    shared = [one(*pair, 0.02 * (k + 1) * (-1) ** k) for k, pair in enumerate(names)]
    names = names[2:]  # with correlations above 5 %, which matter
    remark = only(list(SharedNoiseAddition().remarks(shared, AXES, 0.05)), "noise-shared:calibration")
    assert remark.facts["count"] == len(names) == len(remark.facts["pairs"])
    text = " ".join(texts([remark]))
    assert "13 pairs of axes share noise" in text
    assert text.count("/") <= 4
    assert "accel_y/accel_z" in text
    assert "0.30" in text
