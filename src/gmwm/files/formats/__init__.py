"""Formats of recordings. An import of this package imports them in this order, and they register their readers."""

from importlib import import_module

for _module in (
    "archive", "dataflash", "epson", "hdf5", "waypoint", "matlab", "npy", "oxts", "parquet", "records", "rosbag",
    "sensorlogger", "sentences", "series", "text", "ulog", "xsens",
):  # fmt: skip
    import_module(f"{__name__}.{_module}")
