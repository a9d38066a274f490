"""Readers of recordings, with one module for each file format. `read` and `stream` choose the reader.

>>> "parquet" in [reader.name for reader in registered()]
True
"""

from gmwm.chunks import Chunk
from gmwm.readers import archive as archive
from gmwm.readers import compressed as compressed
from gmwm.readers import dataflash as dataflash
from gmwm.readers import dataflash_text as dataflash_text
from gmwm.readers import epson as epson
from gmwm.readers import hdf5 as hdf5
from gmwm.readers import imr as imr
from gmwm.readers import kalibr as kalibr
from gmwm.readers import matlab as matlab
from gmwm.readers import npy as npy
from gmwm.readers import parquet as parquet
from gmwm.readers import rosbag as rosbag
from gmwm.readers import sensorlogger as sensorlogger
from gmwm.readers import text as text
from gmwm.readers import ulog as ulog
from gmwm.readers import waypoint as waypoint
from gmwm.readers import xsens as xsens
from gmwm.readers.api import read, stream
from gmwm.readers.base import Channel, Layout, Mark, Reader, Rows, find_reader, register, registered
from gmwm.readers.parts import Part
from gmwm.readers.streams import Stream
from gmwm.readers.unit_array import read_array

__all__ = [
    "Channel", "Chunk", "Layout", "Mark", "Part", "Reader", "Rows", "Stream", "find_reader", "read", "read_array",
    "register", "registered", "stream",
]  # fmt: skip
