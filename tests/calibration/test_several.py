"""Several recordings of one unit, calibrated together."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest
from scipy.signal import lfilter

import gmwm
from gmwm.base.errors import DataError, OptionError
from gmwm.calibration import Calibration
from gmwm.calibration.number_verdicts import Usability
from gmwm.recording.signals import Imu
from tests.helpers import code_of, codes, raises

RATE = 50.0
DAYS = ("monday", "tuesday", "wednesday")


def recorded(day, seed, *, sigma2=1e-6, samples=12_000, axes=("gyro_x", "accel_x"), knocks=False):
    truth = {"gyro_x": f"WN(sigma2={sigma2}) + RW(gamma2=1e-11)", "accel_x": "WN(sigma2=2e-5) + RW(gamma2=1e-9)"}
    imu = gmwm.simulate({axis: truth[axis] for axis in axes}, rate=RATE, samples=samples, rng=seed)
    signals = dict(imu.signals)
    if knocks:
        x = signals["gyro_x"].values.copy()
        rng = np.random.default_rng(seed)
        for k in range(1000, samples - 150, 700):
            x[k : k + 150] += 0.005 * rng.standard_normal(150)  # too many samples to be replaced
        signals["gyro_x"] = dataclasses.replace(signals["gyro_x"], values=x)
    return Imu(signals, source=f"/data/{day}.csv")


@pytest.fixture(scope="module")
def days():
    return [recorded(day, k, sigma2=s) for k, (day, s) in enumerate(zip(DAYS, (1e-6, 1.3e-6, 0.8e-6), strict=True))]


@pytest.fixture(scope="module")
def calibration(days):
    return gmwm.calibrate(days, "GM + WN + RW")


@pytest.mark.slow
def test_one_model_for_each_axis_and_the_truth_about_equality(calibration):
    assert list(calibration) == ["gyro_x", "accel_x"]
    gyro, accel = (calibration.axes[axis].replicates for axis in calibration)
    assert gyro.recordings == accel.recordings == DAYS
    assert gyro.differs
    assert not accel.differs
    assert calibration["gyro_x"].gap < 1e-3
    assert calibration["accel_x"].wavelet_variance.samples == 36_000
    found = [remark for remark in calibration.remarks if remark.code.startswith("recordings-")]
    assert {(code_of(remark), remark.subject) for remark in found} == {
        ("recordings-differ:numbers", "gyro_x"), ("recordings-agree:numbers", "accel_x"),
    }  # fmt: skip
    assert gyro["N"].spread == pytest.approx(np.std(np.log([1e-6, 1.3e-6, 0.8e-6]) / 2, ddof=1), rel=0.25)
    assert {candidate.out_of_sample is None for candidate in calibration.rankings["gyro_x"]} == {False}


@pytest.mark.slow
def test_the_numbers_contain_the_spread(calibration, days):
    n = calibration.datasheets["gyro_x"]["N"]
    own = [gmwm.calibrate(day, "WN + RW").datasheets["gyro_x"]["N"] for day in days]
    assert n.low < min(entry.low for entry in own)
    assert n.high > max(entry.high for entry in own)
    assert min(entry.value for entry in own) < n.value < max(entry.value for entry in own)
    low, high = calibration.axes["gyro_x"].intervals["WN.sigma2"]
    assert low < 0.8e-6
    assert high > 1.3e-6
    # The lengths that a poor parameter needs are those of recordings without a spread.
    assert not calibration.axes["gyro_x"].needed


def test_the_recordings_are_described(calibration, tmp_path):
    assert calibration.recording is None
    assert [one.samples for one in calibration.recordings.values()] == [12_000] * 3
    files = [tmp_path / f"{day}.csv" for day in DAYS]
    for k, file in enumerate(files):
        file.write_text(str(k))
    found = calibration.of_file(*files)
    assert [one.file for one in found.recordings.values()] == [f"{day}.csv" for day in DAYS]
    assert len({one.sha256 for one in found.recordings.values()}) == 3
    assert "monday, tuesday, wednesday" in calibration.summary()
    subjects = {remark.subject for remark in calibration.recording_remarks}
    assert all(not subject or subject.split()[-1] in (*DAYS, "gyro_x", "accel_x") for subject in subjects)


@pytest.mark.slow
def test_it_is_saved_drawn_exported_and_reported(calibration, tmp_path):
    calibration.save(tmp_path / "calibration.json")
    again = Calibration.load(tmp_path / "calibration.json")
    assert again.recordings == calibration.recordings
    assert again.summary() == calibration.summary()
    assert again.to_dict() == calibration.to_dict()
    document = json.loads((tmp_path / "calibration.json").read_text(encoding="utf-8"))
    assert document["axes"]["gyro_x"]["replicates"]["recordings"] == list(DAYS)
    assert set(document["axes"]["gyro_x"]["replicates"]["for_filter"]) == {"mean", "high"}
    assert "monday" in calibration.export(format="kalibr")
    calibration.plot(path=tmp_path / "calibration.png")
    page = calibration.report(tmp_path / "report.html").read_text(encoding="utf-8")
    for text in ("The recordings, one by one", "wednesday", "N spread", "p of equality"):
        assert text in page


@pytest.mark.slow
def test_robust_everywhere_if_one_recording_has_knocks(days):
    found = gmwm.calibrate([days[0], recorded("friday", 7, knocks=True)], "WN + RW", axes="gyro_x")
    wv = found["gyro_x"].wavelet_variance
    assert wv.robust
    assert all(one.robust for one in wv.recordings.values())
    assert found.verdicts["gyro_x"].contaminated
    assert found.datasheets["gyro_x"]["N"].value == pytest.approx(np.sqrt(1e-6 / RATE), rel=0.1)


@pytest.mark.slow
def test_streams_and_signals_give_the_same(days, calibration, tmp_path):
    for day, imu in zip(DAYS, days, strict=True):
        imu.write(tmp_path / f"{day}.csv")
    streams = [gmwm.stream(tmp_path / f"{day}.csv", chunk=5000) for day in DAYS]
    found = gmwm.calibrate(streams, "GM + WN + RW")
    assert list(found.recordings) == list(DAYS)
    assert found["gyro_x"].parameters == pytest.approx(calibration["gyro_x"].parameters, rel=1e-6)
    alone = gmwm.calibrate([day["gyro_x"] for day in days], "GM + WN + RW")
    assert list(alone.axes["gyro_x"].replicates.recordings) == ["1", "2", "3"]
    assert alone["gyro_x"].parameters == pytest.approx(calibration["gyro_x"].parameters, rel=1e-9)


@pytest.mark.slow
def test_recordings_with_other_offsets_lengths_and_axes(days):
    far = dataclasses.replace(days[1].signals["gyro_x"], values=days[1].signals["gyro_x"].values + 5.0)
    other = Imu({"gyro_x": far}, source="tuesday.csv")
    found = gmwm.calibrate([days[0], other, recorded("friday", 9, samples=3000)], "WN + RW")
    assert list(found) == ["gyro_x"]
    assert found.failed == {"accel_x": "tuesday does not have this axis"}
    assert found["gyro_x"].wavelet_variance.samples == 27_000
    # A jump of 5 rad/s between the recordings would be a random walk of 1e-3 rad/s/√s and more.
    assert found["gyro_x"].parameters["RW.gamma2"] < 1e-10
    assert found["gyro_x"].parameters["WN.sigma2"] == pytest.approx(1.13e-6, rel=0.05)


@pytest.mark.slow
def test_a_list_of_one_is_one_recording(days, calibration):
    assert gmwm.calibrate(days[:1], "WN + RW").recording.samples == 12_000
    assert gmwm.calibrate(days[:1], "WN + RW").recordings == {}


def test_what_is_refused(days):
    with raises(OptionError, argument="data"):
        gmwm.calibrate([])
    with raises(OptionError, "recordings in the list", argument="data", advises=["gmwm.read"]):
        gmwm.calibrate([days[0], "monday.csv"])
    with raises(OptionError, "recordings in the list", argument="data", advises=["Signal"]):
        gmwm.calibrate([1.0, 2.0])
    with raises(OptionError, "several", argument="workers"):
        gmwm.calibrate(days, workers=2)
    with raises(OptionError, "arrays", argument="against"):
        gmwm.calibrate(days, against=np.arange(12_000.0))
    with raises(DataError, "no axis in common", argument="data"):
        gmwm.calibrate([recorded("monday", 1, axes=("gyro_x",)), recorded("tuesday", 2, axes=("accel_x",))])
    slow = gmwm.simulate({"gyro_x": "WN(sigma2=1e-6)"}, rate=60.0, samples=12_000, rng=1)
    with raises(DataError, "sampling rate"):
        gmwm.calibrate([days[0], slow], axes="gyro_x")


@pytest.mark.slow
def test_files_without_names_are_numbered(days):
    found = gmwm.calibrate([dataclasses.replace(day, source="static.csv") for day in days[:2]], "WN", axes="gyro_x")
    assert list(found.recordings) == ["1", "2"]
    named = gmwm.calibrate({"cold": days[0], "warm": days[1]}, "WN", axes="gyro_x")
    assert list(named.recordings) == ["cold", "warm"]
    assert codes(named.remarks).count("recordings-differ:numbers") == 1


@pytest.mark.slow
def test_recordings_together_are_worse_than_each_alone_only_if_they_differ():
    # A Gauss-Markov process is right for each recording, and no Gauss-Markov process is right for their mean.
    rate, samples = 50.0, 100_000
    units = {}
    for name, time in {"cold": 1.0, "warm": 10.0, "hot": 100.0}.items():
        rng, keep = np.random.default_rng(round(time)), np.exp(-1 / (rate * time))
        steps = 1e-3 * np.sqrt(1 - keep**2) * rng.normal(size=samples)
        slow = lfilter([1.0], [1.0, -keep], steps)
        units[name] = Imu.from_arrays({"gyro_x": 1e-3 * rng.normal(size=samples) + slow}, rate=rate)
    alone = [gmwm.calibrate(unit, "GM + WN").number_verdicts["gyro_x"] for unit in units.values()]
    assert all(of_axis[symbol].usability is Usability.USE for of_axis in alone for symbol in "NK")
    together = gmwm.calibrate(units, "GM + WN").number_verdicts["gyro_x"]
    reasons = {verdict.reason.code for verdict in together.values() if verdict.usability is not Usability.USE}
    assert reasons == {"recordings-differ"}
