"""Each command with --json and other options: the fixture `gmwm` holds what it prints against the schema."""

import numpy as np
import pytest

import gmwm as library

VARIANTS = [
    "agree {a} {b}",
    "agree {a} {b} --reference gyro.N=0.15deg/√h",
    "agree {a} --reference gyro.N=0.15deg/√h --reference accel.N=100µg/√Hz",
    "allan {short}",
    "allan {long} --axis gyro_x --slopes",
    "budget {a} --duration 10s",
    "budget {a} --duration 60s --against {b}",
    "calibrate {short} --axis gyro_x --within WN+RW",
    "calibrate {short} {other} --axis gyro_x --within WN",
    "calibrate {faulty} --within WN+RW",
    "compare {short} --axis gyro_x",
    "compare {short} {other} --axis gyro",
    "consistency {a} {short}",
    "consistency {a} {other} --filter model --horizons 1s,4s",
    "convert {faulty} {folder}/copy.parquet",
    "cross {short} --axis gyro",
    "cross {long} --axis gyro_x --axis accel_x --robust",
    "explain",
    "explain axis-dead",
    "export {a} --format kalibr",
    "export {a} --format state-space",
    "fit {short} -m WN --axis gyro_x",
    "fit {long} -m GM+WN+RW --axis accel_x --robust",
    "fit {short} -m WN+RW --axis gyro_x --ml",
    "fit {faulty} -m AR1+WN --axis gyro",
    "fleet {fleet} --axis gyro --within WN+RW --output {folder}/lot --workers 0",
    "fuse {short} {other} {third} --horizon 1s",
    "fuse {short} {other} --horizon 1s-10s --axis gyro_x",
    "info {short}",
    "info {faulty}",
    "joint {short} --axis gyro --model shared(RW)+WN",
    "joint {other} --axis accel --model common(WN)+WN",
    "plan WN(sigma2=1e-6)+RW(gamma2=1e-12) --rate 100 --duration 2h",
    "plan WN(sigma2=1e-6) --rate 100 --duration 1h --accuracy 10%",
    "psd {short}",
    "psd {faulty} --axis gyro_x --length 256",
    "report {a} --output {folder}/page.html",
    "residuals {short} -m WN --axis gyro_x",
    "residuals {other} --from-fits {a} --axis gyro",
    "same {short} {other}",
    "same {short} {third} --axis gyro_x --model WN+RW",
    "select {short} --axis gyro_x --within GM+WN+RW",
    "select {short} {other} --axis gyro_x --within WN+RW",
    "simulate --model gyro=WN(sigma2=1e-6) --rate 10 --duration 10s --output {folder}/simulated.csv",
    "track {short} -m WN+RW --axis gyro_x",
    "track {other} --from-fits {a} --axis gyro --predict 1s",
    "watch {short} --axis gyro_x --idle 0.1s",
    "watch {faulty} --axis gyro --idle 0.1s -m WN",
    "wv {short}",
    "wv {long} --axis accel_x --robust",
    "monitor {short} --from-fits {a}",
    "monitor {faulty} --from-fits {a} --every 1h",
    "monitor {short} {other} {third} --from-fits {a} --axis gyro_x",
    "monitor {short} {faulty} {third} --from-fits {a} --axis gyro_x --every 1h",
]


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Recordings of two minutes and one with faults, two calibrations, and a folder of recordings."""
    folder = tmp_path_factory.mktemp("variants")
    truth = {"gyro": "WN(sigma2=4e-7) + RW(gamma2=1e-11)", "accel": "WN(sigma2=2e-5)"}
    paths = {"folder": folder, "fleet": folder / "fleet"}
    paths["fleet"].mkdir()
    for seed, name in enumerate(("short", "other", "third", "long")):
        samples = 20_000 if name == "long" else 8_000
        imu = library.simulate(truth, rate=100.0, samples=samples, rng=seed)
        paths[name] = folder / f"{name}.csv"
        imu.write(paths[name])
        if name in ("short", "other"):
            imu.write(paths["fleet"] / f"{name}.csv")
    for name, recording in (("a", "short"), ("b", "other")):
        paths[name] = folder / name / "calibration.json"
        paths[name].parent.mkdir()
        library.calibrate(library.read(paths[recording]), within="WN + RW").save(paths[name])
    third = library.read(paths["third"])
    values = {axis: third[axis].values.copy() for axis in third}
    values["gyro_x"][3_000:] *= 3.0
    values["gyro_y"][500:4_000:97] += 0.1
    values["gyro_z"][4_000:] += 0.02
    values["accel_x"][1_000:1_200] = values["accel_x"][1_000]
    values["accel_y"] += 0.05 * np.sin(2 * np.pi * 7.3 * np.arange(8_000) / 100)
    paths["faulty"] = folder / "faulty.csv"
    library.Imu.from_arrays(values, rate=100.0).write(paths["faulty"])
    return paths


@pytest.mark.slow
@pytest.mark.parametrize("command", VARIANTS)
def test_the_json_has_its_schema(gmwm, files, command):
    words = [word.format(**files) for word in command.split()]
    assert gmwm(*words, "--json").code in (0, 1), command
