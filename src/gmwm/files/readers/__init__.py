"""Readers of recordings, with one module for each file format. `read` and `stream` choose the reader.

>>> "parquet" in [reader.name for reader in registered()]
True
"""

from gmwm.files.readers import archive as archive
from gmwm.files.readers import compressed as compressed
from gmwm.files.readers import dataflash as dataflash
from gmwm.files.readers import dataflash_text as dataflash_text
from gmwm.files.readers import epson as epson
from gmwm.files.readers import hdf5 as hdf5
from gmwm.files.readers import imr as imr
from gmwm.files.readers import kalibr as kalibr
from gmwm.files.readers import matlab as matlab
from gmwm.files.readers import npy as npy
from gmwm.files.readers import parquet as parquet
from gmwm.files.readers import rosbag as rosbag
from gmwm.files.readers import sensorlogger as sensorlogger
from gmwm.files.readers import text as text
from gmwm.files.readers import ulog as ulog
from gmwm.files.readers import waypoint as waypoint
from gmwm.files.readers import xsens as xsens
from gmwm.files.readers.api import read, stream
from gmwm.files.readers.base import Channel, Layout, Mark, Reader, Rows, find_reader, register, registered
from gmwm.files.readers.parts import Part
from gmwm.files.readers.streams import Stream
from gmwm.files.readers.unit_array import read_array
from gmwm.recording.chunks import Chunk

__all__ = [
    "Channel", "Chunk", "Layout", "Mark", "Part", "Reader", "Rows", "Stream", "find_reader", "read", "read_array",
    "register", "registered", "stream",
]  # fmt: skip
