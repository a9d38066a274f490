"""Recordings written to CSV or Parquet, so that `gmwm.read` gives the same numbers back, bit for bit."""

from __future__ import annotations

import os
from pathlib import Path

from gmwm._files import written_whole
from gmwm.errors import OptionError
from gmwm.signals import Imu

SUFFIXES = (".csv", ".parquet")
"""The file name extensions that choose a format."""


def write(imu: Imu, path: str | os.PathLike[str]) -> None:
    """Write a recording; the suffix of the path chooses the format, .csv or .parquet.

    The columns are `time [s]`, the axes with their units as in `gyro_x [rad/s]`, and `temperature [°C]` if
    there is one. Numbers keep full precision. Times are those of the uniform clock of each segment, from
    the segment's start on, so gaps stay gaps. The file appears whole or not at all.

    Parameters
    ----------
    imu : Imu
        The recording.
    path : path
        Where to; folders on the way are made.

    Raises
    ------
    OptionError
        If the suffix is neither .csv nor .parquet.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> folder = tempfile.TemporaryDirectory()
    >>> path = pathlib.Path(folder.name, "three.csv")
    >>> write(Imu.from_arrays({"gyro_x": [0.1, 0.2, 0.3]}, rate=100), path)
    >>> path.read_text().splitlines()[:2]
    ['time [s],gyro_x [rad/s]', '0.0,0.1']
    >>> folder.cleanup()
    """
    import polars as pl

    target = Path(path)
    suffix = target.suffix.lower()
    if suffix not in SUFFIXES:
        raise OptionError(f"path must end in {' or '.join(SUFFIXES)}, got {target.name!r}")
    columns = {"time [s]": imu[imu.axes[0]].times()}
    for axis in imu:
        unit = imu[axis].unit
        columns[f"{axis} [{unit}]" if unit else axis] = imu[axis].values
    if imu.temperature is not None:
        columns["temperature [°C]"] = imu.temperature
    frame = pl.DataFrame(columns)
    with written_whole(target) as temporary:
        if suffix == ".csv":
            frame.write_csv(temporary)
        else:
            frame.write_parquet(temporary)
