"""The contract of readers, and laws that every registered one keeps."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

from gmwm.base.errors import DataError, GmwmError, GmwmWarning, OptionError, ReadError
from gmwm.base.extras import admit_guests
from gmwm.base.remarks import Remark
from gmwm.files import contract
from gmwm.files.readers import Channel, Layout, Reader, Rows, find_reader, read, register, registered
from gmwm.recording import writers
from gmwm.recording.signals import Imu
from tests.helpers import raises, warns


@pytest.fixture
def increments(monkeypatch):
    """A format that no file of ours has: a signature, increments, its own units and rate, two topics on demand."""
    monkeypatch.setattr(contract, "_READERS", dict(contract._READERS))

    @register
    class Increments(Reader):
        name: ClassVar[str] = "increments"
        extensions: ClassVar[tuple[str, ...]] = (".inc",)

        def sniff(self, path: Path, head: bytes) -> float:
            return 1.0 if head.startswith(b"INCR") else 0.0

        def layouts(self, path: Path) -> tuple[Layout, ...]:
            channels = (Channel("dtheta", "deg/s", "gyro_x", increments=True), Channel("dv", "g", "accel_y"))
            topics = path.read_text().split()[1:]
            return tuple(
                Layout(
                    channels,
                    topic=topic,
                    rate=50.0,
                    remarks=(Remark.of("file-content", case="layout", format="made up"),),
                )
                for topic in topics
            )

        def chunks(self, path: Path, layout: Layout, wanted: Sequence[int]) -> Iterator[Rows]:
            for start in (0, 4, 8):
                yield {k: np.arange(start, start + 4) * (k + 1.0) for k in wanted}

    return Increments


def test_a_format_carries_units_increments_rate_and_remarks(tmp_path, increments):
    path = tmp_path / "a.csv"
    path.write_text("INCR imu0")
    imu = read(path)
    assert imu.rate == 50
    np.testing.assert_allclose(imu["gyro_x"].values, np.radians(np.arange(12.0)) * 50, rtol=1e-15)
    np.testing.assert_allclose(imu["accel_y"].values, np.arange(12) * 2 * 9.80665, rtol=1e-15)
    assert imu.remarks[0] == Remark.of("file-content", case="layout", format="made up")
    path.write_text("INCR imu0 imu1")
    with raises(ReadError, "2 recordings", "imu0", "imu1", advises=["topic="]):
        read(path)


def test_a_reader_defined_anew_takes_the_place_of_the_older(increments):
    anew = type("Increments", (increments,), {"__module__": increments.__module__})
    anew.__qualname__ = increments.__qualname__
    register(anew)
    assert [type(reader) for reader in registered() if reader.name == "increments"] == [anew]


@pytest.mark.parametrize("other", [{"__module__": "elsewhere"}, {"__qualname__": "Another"}, {"name": "Increments"}])
def test_a_name_is_registered_once(increments, other):
    anew = type("Increments", (increments,), {"__module__": increments.__module__})
    for name, value in {"__qualname__": increments.__qualname__, **other}.items():
        setattr(anew, name, value)
    with raises(OptionError, "'increments'", "already", "test_registry", advises=["another name"]):
        register(anew)
    assert increments in map(type, registered())


def test_no_reader_takes_the_place_of_a_built_in_one(increments):
    (built_in,) = [type(reader) for reader in registered() if reader.name == "parquet"]
    with raises(OptionError, "'parquet'", "already", "gmwm.files.formats.parquet"):
        register(built_in)


def test_every_reader_says_who_it_is():
    names = [reader.name for reader in registered()]
    assert {"parquet", "text", "imu", "imu:LN200", "imr", "ulog"} <= set(names)
    assert len({name.casefold() for name in names}) == len(names)
    for reader in registered():
        assert type(reader).__doc__
        assert all(suffix.startswith(".") and suffix.islower() for suffix in reader.extensions)


@pytest.mark.parametrize("suffix", writers.SUFFIXES)
def test_only_one_reader_knows_a_file(tmp_path, suffix):
    path = tmp_path / f"a{suffix}"
    writers.write(Imu.from_arrays({"gyro_x": np.arange(20.0)}, 10), path)
    head = path.read_bytes()
    knowing = [reader.name for reader in registered() if reader.sniff(path, head) > 0]
    assert knowing == [find_reader(path).name]


@pytest.mark.slow
@pytest.mark.parametrize("suffix", writers.SUFFIXES)
def test_a_file_cut_anywhere_is_an_error_or_a_shorter_recording(tmp_path, suffix):
    path = tmp_path / f"a{suffix}"
    values = np.random.default_rng(4).normal(size=(30, 2))
    writers.write(Imu.from_arrays({"gyro_x": values[:, 0], "accel_z": values[:, 1]}, 10), path)
    whole = path.read_bytes()
    for size in range(0, len(whole), 41):
        path.write_bytes(whole[:size])
        try:
            imu = read(path)
        except (GmwmError, GmwmWarning):
            continue
        # A cut inside the last number cannot be seen; all before it must be right.
        assert imu["gyro_x"].values[:-1].tolist() == values[: len(imu) - 1, 0].tolist()


@pytest.mark.slow
def test_import_is_light():
    code = (
        "import sys, gmwm.readers, gmwm.recording.writers, gmwm.inspection;"
        "heavy = {'polars', 'matplotlib', 'scipy.optimize', 'scipy.stats'} & set(sys.modules);"
        "sys.exit(str(heavy) if heavy else 0)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize(
    ("path", "advises"), [(None, []), (3, []), (np.ones((9, 3)), ["Imu.from_arrays"]), (b"x.csv", [])]
)
def test_what_is_no_path_is_told(path, advises):
    with raises(OptionError, argument="path", advises=advises) as caught:
        read(path)
    assert caught.value.got is path


def test_a_pipe_is_refused(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with raises(ReadError, pipe, "pipe", advises=["file"]):
        read(pipe)


def test_names_that_repeat_are_chosen_by_number(tmp_path):
    path = tmp_path / "repeated.csv"
    rows = "".join(f"{k / 100},{k % 7},{k % 3}\n" for k in range(50))
    path.write_text("time [s],gx [rad/s],gx [rad/s]\n" + rows)
    with raises(ReadError, path, "number 1", "number 2", advises=["columns={'time': 0, 'gyro_x': 1}"]):
        read(path)
    with raises(OptionError, "1 and 2", argument="columns"):
        read(path, columns={"gyro_x": "gx [rad/s]"})
    assert read(path, columns={"time": 0, "gyro_x": 2})["gyro_x"].values[4] == 1.0


def test_one_sample_is_singular(tmp_path):
    path = tmp_path / "one.csv"
    path.write_text("time [s],gx [rad/s]\n0,1\n")
    with raises(DataError, path, "1 sample", "at least 8"):
        read(path)


GUEST = """
from gmwm.readers import Channel, Layout, Reader

class GuestReader(Reader):
    name, extensions = "guest", (".guest",)

    def sniff(self, path, head):
        return float(head.startswith((b"\\x00GUEST", b"#GUEST")))

    def layouts(self, path):
        return (Layout((Channel("x", "rad/s", "gyro_x"),), rate=10.0),)

    def chunks(self, path, layout, wanted):
        import numpy as np
        yield {k: np.arange(20.0) for k in wanted}
"""


@pytest.fixture
def guest(tmp_path, monkeypatch):
    """An installed package with a reader, and with one that cannot be imported. Return a file of its format."""
    monkeypatch.setattr(contract, "_READERS", dict(contract._READERS))
    (tmp_path / "guest_reader.py").write_text(GUEST)
    folder = tmp_path / "guest_logs-1.0.dist-info"
    folder.mkdir()
    (folder / "METADATA").write_text("Metadata-Version: 2.1\nName: guest-logs\nVersion: 1.0\n")
    entries = "[gmwm.readers]\nbroken = lacking_module:Reader\nguest = guest_reader:GuestReader\n"
    (folder / "entry_points.txt").write_text(entries)
    monkeypatch.syspath_prepend(tmp_path)
    admit_guests.cache_clear()
    path = tmp_path / "a.guest"
    path.write_bytes(b"\x00GUEST")
    yield path
    admit_guests.cache_clear()
    sys.modules.pop("guest_reader", None)


def test_a_guest_is_loaded_unless_a_signature_of_an_own_format_fits(tmp_path, guest):
    array = tmp_path / "own.npy"
    np.save(array, np.arange(40.0)[:, None] % 3)
    assert read(array, rate=10.0, columns=["gyro_x"], units={"gyro": "rad/s"}).rate == 10.0
    assert "guest_reader" not in sys.modules
    with warns("guest-unusable", name="broken", package="guest-logs", group="gmwm.readers"):
        imu = read(guest)
    assert imu["gyro_x"].values.tolist() == list(range(20))
    assert read(guest, format="GUEST")["gyro_x"].values.size == 20


@pytest.mark.parametrize("suffix", [".guest", ".csv"])
def test_the_signature_of_a_guest_wins_over_plausible_text(tmp_path, guest, suffix):
    text = tmp_path / f"text{suffix}"
    text.write_text("#GUEST\n" + (table := "gyro_x [rad/s]\n" + "".join(f"{k % 3}\n" for k in range(40))))
    other = tmp_path / "other.csv"
    other.write_text(table)
    with warns("guest-unusable"):
        assert len(read(text)) == 20
    assert len(read(other, rate=10.0)) == 40


@pytest.mark.parametrize("form", ["list", "format"])
def test_guests_are_loaded_when_formats_are_listed_or_named(guest, form):
    with warns("guest-unusable"):
        if form == "list":
            assert registered()[-1].name == "guest"
        else:
            read(guest, format="guest")


def test_a_guest_must_be_a_reader(guest, tmp_path):
    entries = "[gmwm.readers]\nother = guest_reader:Channel\ntext = guest_reader:Taken\n"
    (tmp_path / "guest_logs-1.0.dist-info" / "entry_points.txt").write_text(entries)
    module = tmp_path / "guest_reader.py"
    module.write_text(GUEST + "\nclass Taken(GuestReader):\n    name = 'text'\n")
    with pytest.warns(GmwmWarning) as warnings:
        names = [reader.name for reader in registered()]
    assert [warning.message.remark.facts["name"] for warning in warnings] == ["other", "text"]
    assert names.count("text") == 1
