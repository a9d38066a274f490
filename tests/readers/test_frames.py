"""Tables in memory become recordings as files do, without importing the libraries that made them."""

import datetime
import subprocess
import sys

import numpy as np
import polars as pl
import pytest

from gmwm.base.errors import DataError, OptionError, ReadError
from gmwm.base.units import AXES
from gmwm.recording.signals import Imu
from tests.helpers import raises, warns

ROWS = 400
VALUES = np.random.default_rng(1).normal(size=(ROWS, 6)) * 0.1 + [0, 0, 0, 0, 0, 9.8]
COLUMNS = {axis: VALUES[:, k] for k, axis in enumerate(AXES)}
TIME = np.arange(ROWS) / 200
BEGIN = datetime.datetime(2024, 5, 1, tzinfo=datetime.timezone.utc)


def same(imu, rate=200.0):
    assert imu.axes == AXES
    assert imu.rate == pytest.approx(rate, rel=1e-9)
    assert len(imu.segments) == 1
    np.testing.assert_array_equal(np.column_stack([imu[axis].values for axis in AXES]), VALUES)


def test_polars():
    frame = pl.DataFrame({"time": TIME} | COLUMNS)
    same(Imu.from_arrays(frame))
    same(Imu.from_arrays(frame.lazy()))
    same(Imu.from_arrays(frame.drop("time"), 50), 50)
    dated = pl.datetime_range(BEGIN, BEGIN + datetime.timedelta(seconds=1.995), "5ms", eager=True)
    same(Imu.from_arrays(frame.with_columns(time=dated)))
    assert Imu.from_arrays(frame.with_columns(time=dated))["gyro_x"].start == BEGIN.timestamp()


def test_pandas():
    pd = pytest.importorskip("pandas")
    frame = pd.DataFrame(COLUMNS)
    same(Imu.from_arrays(frame, 50), 50)
    same(Imu.from_arrays(frame.set_index(pd.date_range("2024-05-01", periods=ROWS, freq="5ms"))))
    same(Imu.from_arrays(frame.set_index(pd.date_range("2024-05-01", periods=ROWS, freq="5ms", tz="Asia/Tokyo"))))
    same(Imu.from_arrays(frame.set_index(pd.to_timedelta(TIME, unit="s"))))
    same(Imu.from_arrays(frame.set_index(pd.Index(TIME, name="time"))))
    many = frame.copy()
    many.columns = pd.MultiIndex.from_tuples([axis.split("_") for axis in AXES])
    same(Imu.from_arrays(many, 50), 50)
    frame.iloc[7, 2] = np.nan
    with warns("samples-lost:axes", count=1):
        assert Imu.from_arrays(frame, 200).segments == ((0, 7), (7, ROWS - 1))


class DataArray:
    """What `read_table` uses of xarray."""

    def __init__(self, values, dims, coords, name=None):
        self.values, self.dims, self.name, self.ndim = np.asarray(values), dims, name, np.ndim(values)
        self.coords, self.attrs = coords, {}


class Dataset:
    """What `read_table` uses of xarray."""

    def __init__(self, variables, coords):
        self.data_vars, self.coords = variables, coords


LENGTHS = (TIME * 1e9).astype("m8[ns]")


@pytest.mark.parametrize("clock", [TIME, LENGTHS, np.datetime64(0, "ns") + LENGTHS])
def test_xarray(clock):
    time = DataArray(clock, ("time",), {})
    axes = DataArray(list(AXES), ("axis",), {})
    table = DataArray(VALUES, ("time", "axis"), {"time": time, "axis": axes})
    same(Imu.from_arrays(table))
    parts = {"gyro": VALUES[:, :3], "accel": VALUES[:, 3:]}
    variables = {name: DataArray(part, ("time", "xyz"), {"time": time}) for name, part in parts.items()}
    same(Imu.from_arrays(Dataset(variables, {"time": time})))


class ArrowTable:
    """What `read_table` uses of a table of Arrow."""

    def __init__(self, columns):
        self._columns = columns

    @property
    def column_names(self):
        return list(self._columns)

    def column(self, name):
        return DataColumn(self._columns[name])


class DataColumn:
    """A column of a table of Arrow."""

    def __init__(self, values):
        self._values = values

    def to_numpy(self):
        return self._values


@pytest.mark.parametrize("clock", [TIME, np.datetime64("2024-05-01", "ns") + LENGTHS])
def test_arrow(clock):
    same(Imu.from_arrays(ArrowTable({"time": clock} | COLUMNS)))


def test_mappings_and_records():
    same(Imu.from_arrays({"time": TIME} | COLUMNS))
    same(Imu.from_arrays({"t": TIME, "gyro": VALUES[:, :3], "accel": VALUES[:, 3:]}))
    records = np.zeros(ROWS, dtype=[("time", float), *((axis, float) for axis in AXES)])
    for name, column in ({"time": TIME} | COLUMNS).items():
        records[name] = column
    same(Imu.from_arrays(records))
    masked = {"gyro_x": np.ma.masked_invalid(np.where(np.arange(ROWS) == 9, np.nan, VALUES[:, 0]))}
    with warns("samples-lost:lost", count=1):
        assert Imu.from_arrays(masked, 100).segments == ((0, 9), (9, ROWS - 1))


def test_units_of_names_count_and_others_are_si():
    degrees = {"gyro_x [deg/s]": VALUES[:, 0], "accel_x": VALUES[:, 3], "time [ms]": 5 * np.arange(ROWS)}
    imu = Imu.from_arrays(degrees)
    np.testing.assert_allclose(imu["gyro_x"].values, np.radians(VALUES[:, 0]))
    np.testing.assert_array_equal(imu["accel_x"].values, VALUES[:, 3])
    in_g = Imu.from_arrays({"time": TIME, "accel_x": VALUES[:, 3]}, units={"accel": "g"})
    np.testing.assert_allclose(in_g["accel_x"].values, 9.80665 * VALUES[:, 3])


def test_what_cannot_be_used():
    with raises(ReadError, code="no-time", advises=["rate="]):
        Imu.from_arrays(pl.DataFrame(COLUMNS))
    with raises(OptionError, argument="rate"):
        Imu.from_arrays(VALUES)
    with raises(ReadError, code="no-inertial-data"):
        Imu.from_arrays({"pressure": VALUES[:, 0]}, 100)
    with pytest.raises((DataError, ReadError)):
        Imu.from_arrays({"gyro_x": VALUES[:, 0], "accel_x": VALUES[:9, 3]}, 100)


@pytest.mark.slow
def test_no_library_of_tables_is_imported():
    code = (
        "import sys, numpy as np, gmwm; gmwm.Imu.from_arrays({'time': np.arange(9) / 100, 'gyro_x': np.arange(9.0)});"
        "found = {'pandas', 'polars', 'xarray'} & set(sys.modules); sys.exit(str(found) if found else 0)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
