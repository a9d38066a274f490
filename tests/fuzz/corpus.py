"""Small good files of each family of readers, which the fuzzer changes, and the documents that gmwm writes."""

from __future__ import annotations

import gzip
import io
import json
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path

import h5py
import numpy as np
import scipy.io

import gmwm
from gmwm.applications.app.session import Session
from gmwm.base.errors import GmwmError
from gmwm.files.formats.byte_sources import zstd_library
from gmwm.files.importers import given_noise
from gmwm.recording.imu_records import TYPES
from gmwm.showing.exporters import export_formats
from gmwm.showing.exporters.given import given_calibration
from tests.readers import rosbag_files, test_dataflash, test_imr, test_matlab, test_ulog, test_waypoint
from tests.readers.test_layouts import LAYOUTS
from tests.readers.test_loggers import LAYOUTS as LOGGERS

ROWS = 300
AXES = ("gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z")
DEVICE = Path(__file__).resolve().parents[3] / "shared" / "data" / "device"
DEVICE_BYTES = 60_000
"""Number of bytes of a file of a real device that are used."""

Files = Iterator[tuple[str, bytes]]


def _numbers() -> np.ndarray:
    return np.random.default_rng(1).normal(size=(ROWS, 6)) * 0.01 + [0, 0, 0, 0, 0, 9.81]


def _csv(sep: str = ",", comma: bool = False, header: str = "") -> bytes:
    names = ["time [s]", *(f"{axis} [{'rad/s' if axis[0] == 'g' else 'm/s²'}]" for axis in AXES)]
    rows = [[f"{k / 100:.3f}", *(f"{v:.6f}" for v in row)] for k, row in enumerate(_numbers())]
    text = "\n".join([header + sep.join(names), *(sep.join(row) for row in rows)]) + "\n"
    return (text.replace(".", ",") if comma else text).encode()


def _joined(values: np.ndarray, sep: str = ",", digits: int = 6) -> str:
    return sep.join(f"{v:.{digits}f}" for v in values)


def _dates() -> str:
    times = (f"2024-05-01 12:00:{k // 100:02d}.{k % 100:02d}" for k in range(ROWS))
    rows = (f"{time},{_joined(row)}" for time, row in zip(times, _numbers(), strict=True))
    return "\n".join(["date,gx [deg/s],gy [deg/s],gz [deg/s],ax [g],ay [g],az [g]", *rows, ""])


def _serial() -> str:
    times = (f"12:00:{k // 100:02d}.{10 * (k % 100):03d}" for k in range(ROWS))
    return "\n".join(f"{time} -> ax:{row[0]:.3f} ay:{row[1]:.3f}" for time, row in zip(times, _numbers(), strict=True))


def _kalibr() -> str:
    axes = [
        f"{name}_{axis} [{unit}]" for name, unit in (("w_RS_S", "rad s^-1"), ("a_RS_S", "m s^-2")) for axis in "xyz"
    ]
    rows = (f"{10**18 + 5_000_000 * k},{_joined(row)}" for k, row in enumerate(_numbers()))
    return "\n".join([f"#timestamp [ns],{','.join(axes)}", *rows, ""])


def _xsens() -> str:
    names = "PacketCounter SampleTimeFine Acc_X Acc_Y Acc_Z Gyr_X Gyr_Y Gyr_Z".replace(" ", "\t")
    rows = (f"{k}\t{100 * k}\t{_joined(row[[3, 4, 5, 0, 1, 2]], chr(9))}" for k, row in enumerate(_numbers()))
    return "\n".join(["// Update Rate: 100.0Hz", names, *rows, ""])


def text() -> Files:
    """Tables with several dialects, stamps and headers."""
    yield "comma.csv", _csv()
    yield "semicolon.csv", _csv(";", comma=True)
    yield "blanks.txt", _csv(" ", header="# sample rate: 100 Hz\n# gyro in rad/s, accel in m/s^2\n")
    yield "dates.csv", _dates().encode()
    yield "serial.txt", _serial().encode()
    stamps = [f"{1_700_000_000 + k // 200},{5_000_000 * (k % 200)},{v:.6f}" for k, v in enumerate(_numbers()[:, 0])]
    yield "ros.csv", "\n".join(["header.stamp.sec,header.stamp.nanosec,angular_velocity.x", *stamps]).encode()
    yield "kalibr.csv", _kalibr().encode()
    yield "xsens.txt", _xsens().encode()
    for name in ("mikoff_imu0.log", "xio_sensor_data.csv"):
        if (DEVICE / name).exists():
            yield name, (DEVICE / name).read_bytes()[:DEVICE_BYTES]


def packed() -> Files:
    """Compressed tables, and archives of phones."""
    yield "static.csv.gz", gzip.compress(_csv(), mtime=0)
    yield "static.csv.zst", zstd_library().compress(_csv())
    for method in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        with zipfile.ZipFile(buffer := io.BytesIO(), "w", method) as archive:
            for name, columns in (("Gyroscope", slice(0, 3)), ("Accelerometer", slice(3, 6))):
                rows = (f"{10**18 + 10**7 * k},{k / 100},{_joined(row[columns])}" for k, row in enumerate(_numbers()))
                archive.writestr(f"{name}.csv", "\n".join(["time,seconds_elapsed,z,y,x", *rows, ""]))
        yield f"phone{method}.zip", buffer.getvalue()


def arrays() -> Files:
    """Files of NumPy."""
    for order in "CF":
        np.save(buffer := io.BytesIO(), np.asarray(_numbers(), order=order))
        yield f"matrix{order}.npy", buffer.getvalue()
    records = np.zeros(ROWS, [("t", "<f8"), *((axis, "<f4") for axis in AXES)])
    records["t"] = np.arange(ROWS) / 100
    for axis, column in zip(AXES, _numbers().T, strict=True):
        records[axis] = column
    np.save(buffer := io.BytesIO(), records)
    yield "records.npy", buffer.getvalue()
    for save in (np.savez, np.savez_compressed):
        save(buffer := io.BytesIO(), time=np.arange(ROWS) / 100, gyro=_numbers()[:, :3], accel=_numbers()[:, 3:])
        yield f"{save.__name__}.npz", buffer.getvalue()


def matlab() -> Files:
    """Files of MATLAB, versions 5 to 7."""
    content = {"time": np.arange(ROWS) / 100, "gyro": _numbers()[:, :3], "accel": _numbers()[:, 3:], "fs": 100.0}
    for packing in (False, True):
        scipy.io.savemat(buffer := io.BytesIO(), content, do_compression=packing)
        yield f"v{5 + 2 * packing}.mat", buffer.getvalue()
    scipy.io.savemat(buffer := io.BytesIO(), {"imu": content})
    yield "struct.mat", buffer.getvalue()


def hdf5(folder: Path) -> Files:
    """Files of HDF5, and MATLAB's version 7.3."""
    with h5py.File(folder / "a.h5", "w") as file:
        file["time"], file["gyro"], file["accel"] = np.arange(ROWS) / 100, _numbers()[:, :3], _numbers()[:, 3:]
        file["gyro"].attrs["unit"], file["accel"].attrs["unit"] = "rad/s", "m/s²"
    yield "plain.h5", (folder / "a.h5").read_bytes()
    with h5py.File(folder / "b.h5", "w") as file:
        group = file.create_group("imu0")
        for axis, column in zip(AXES, _numbers().T, strict=True):
            group.create_dataset(axis, data=column, chunks=(64,), compression="gzip", shuffle=True, fletcher32=True)
        group.attrs["rate"] = 100.0
    yield "chunked.h5", (folder / "b.h5").read_bytes()
    test_matlab.newer(folder / "c.mat", {"time": np.arange(ROWS) / 100, "gyro": _numbers()[:, :3]})
    yield "v73.mat", (folder / "c.mat").read_bytes()


def parquet(folder: Path) -> Files:
    """Files of Parquet."""
    imu = gmwm.Imu.from_arrays(dict(zip(AXES, _numbers().T, strict=True)), 100.0)
    imu.write(folder / "a.parquet")
    yield "static.parquet", (folder / "a.parquet").read_bytes()
    import polars as pl

    times = pl.datetime_range(pl.datetime(2024, 1, 1), pl.datetime(2024, 1, 1, 0, 0, 2), "10ms", eager=True)
    frame = pl.DataFrame({"time": times, "gyro_x": np.sin(np.arange(times.len()) ** 2)})
    frame.write_parquet(folder / "b.parquet", compression="snappy")
    yield "dates.parquet", (folder / "b.parquet").read_bytes()


def rosbag(folder: Path) -> Files:
    """Recordings of ROS 1 and 2, one for each container and compression."""
    for container in rosbag_files.CONTAINERS:
        path = rosbag_files.recorded(folder, container)
        files = [path] if path.is_file() else sorted(file for file in path.iterdir() if file.is_file())
        for file in files:
            if file.suffix != ".yaml":
                yield f"{container}{''.join(file.suffixes)}", file.read_bytes()


def devices() -> Files:
    """Logs of PX4 and ArduPilot, and records of NovAtel and Waypoint."""
    yield "combined.ulg", test_ulog.combined()
    yield "sensors.ulg", test_ulog.sensors()
    parts = [test_dataflash.imu(k, k % 2) for k in range(ROWS)]
    yield "log.bin", test_dataflash.log(parts)
    yield "static.imr", test_imr.imr()
    for kind in TYPES:
        yield f"{kind.name}.imu", test_waypoint.packed(kind, test_waypoint.rows_of(kind, ROWS))
    if (DEVICE / "PX4_pyulog_sample_log_small.ulg").exists():
        yield "px4.ulg", (DEVICE / "PX4_pyulog_sample_log_small.ulg").read_bytes()[:DEVICE_BYTES]


def layouts() -> Files:
    """Files of loggers as their descriptions state, which are read without options."""
    for k, layout in enumerate((*LAYOUTS, *LOGGERS)):
        if not layout.options:
            name = layout.file if layout.file in ("ms25.csv", "xsens_imu.csv") else f"{k}_{layout.file}"
            yield name, layout.text().encode(layout.encoding)


FAMILIES: dict[str, Callable[[Path], Files]] = {
    "text": lambda folder: text(),
    "layouts": lambda folder: layouts(),
    "packed": lambda folder: packed(),
    "arrays": lambda folder: arrays(),
    "matlab": lambda folder: matlab(),
    "hdf5": hdf5,
    "parquet": parquet,
    "rosbag": rosbag,
    "devices": lambda folder: devices(),
}
"""The families of readers, with the function that makes their files in a folder."""


def importers(folder: Path) -> Files:
    """Yield the files of other programs with noise numbers, as gmwm writes them."""
    noise = given_noise("gyro: N=0.15deg/√h, K=2deg/h/√h; accel: N=60µg/√Hz, K=1e-4m/s²/√s", 200.0)
    found = given_calibration(noise)
    for name in export_formats():
        try:
            yield f"{name}.txt", found.export(format=name).encode()
        except GmwmError:
            continue  # the format needs terms that the text does not state


TEXTS = {
    "datasheet": "gyro: N=0.15deg/√h, B=3deg/h over 100s, K=1e-6rad/s/√s; accel_x: N=60µg/√Hz, VRE=0.02g/sqrt(Hz)",
    "model": "2*GM(beta=fixed(0.1), sigma2=1e-6) + WN + RW(gamma2=1e-12) + SARMA(1, 0, 1, 1, 12) + AR(3) + FGN(H=0.7)",
    "reference": "gyro.N = 2.0 deg/√h",
    "columns": "gyro_x=wx,gyro_y=3,time=",
    "scale": "gyro=1/131,accel_x=6.1e-5",
    "length": "1h20min3.5s",
}


def texts(folder: Path) -> Files:
    """Yield texts that users type as options."""
    yield from ((f"{name}.txt", text.encode()) for name, text in TEXTS.items())


def documents(folder: Path) -> dict[str, bytes]:
    """Return the documents that gmwm reads: a calibration, fits, a fleet, and the states of accumulators and
    monitors."""
    from gmwm.cli.output import json_text

    x = gmwm.Model.parse("WN(sigma2=4e-7) + RW(gamma2=1e-10)").simulate(3000, 100.0, rng=1)
    signal = gmwm.Signal(x, 100.0, "rad/s", "gyro_x")
    found = gmwm.calibrate(signal, "WN + RW")
    fit, likely = gmwm.fit("WN + RW", signal), gmwm.fit_ml("WN + RW", signal)
    fits = {"file": "a.csv", "axes": {"gyro_x": fit.to_dict() | {"likelihood": likely.to_dict()}}}
    (folder / "units").mkdir()
    gmwm.Imu({"gyro_x": signal}).write(folder / "units" / "a.parquet")
    gmwm.fleet(folder / "units", folder / "fleet", within="WN + RW", workers=0)
    live = gmwm.WaveletAccumulator(rate=100.0, robust=True, held=0, exact=6, levels=6)
    live.update(x[:500])
    state = {name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in live.to_dict().items()}
    return {
        "calibration.json": json.dumps(found.to_dict()).encode(),
        "fits.json": json_text("fit", fits).encode(),
        "fleet.json": (folder / "fleet" / "fleet.json").read_bytes(),
        "accumulator.json": json.dumps(state).encode(),
        "monitor.json": json.dumps(gmwm.Monitor(found).to_dict()).encode(),
        "session.json": Session(
            file="a.csv",
            reading={"rate": 100, "units": {"gyro": "deg/s"}, "skip": [(1, 2)], "columns": {"gyro_x": 1}},
            axis="gyro_x",
            robust=True,
            models={"gyro_x": "WN + RW"},
            reference={"gyro.N": "2.0 deg/√h"},
            rule="worst",
        )
        .to_text()
        .encode(),
    }


OTHERS = {
    "documents": lambda folder: documents(folder).items(),
    "importers": importers,
    "texts": texts,
}
"""The families of other input, with the function that makes their files."""
