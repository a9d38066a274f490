"""Formats of recordings, one module each. An import of this package registers them, in this order."""

from gmwm.files.formats import (
    archive,
    compressed,
    dataflash,
    dataflash_text,
    epson,
    hdf5,
    imr,
    kalibr,
    matlab,
    npy,
    oxts,
    parquet,
    records,
    rosbag,
    sensorlogger,
    sentences,
    text,
    ulog,
    waypoint,
    xsens,
)  # fmt: skip

__all__ = [
    "archive", "compressed", "dataflash", "dataflash_text", "epson", "hdf5", "imr", "kalibr", "matlab", "npy", "oxts",
    "parquet", "records", "rosbag", "sensorlogger", "sentences", "text", "ulog", "waypoint", "xsens",
]  # fmt: skip
