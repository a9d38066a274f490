"""From a file to a recording: `read` and `stream`, and the contract for readers of further formats.

>>> "parquet" in [reader.name for reader in registered()]
True
"""

from gmwm.files.clock.missing_values import MISSING
from gmwm.files.contract import Channel, Layout, Mark, Reader, Rows, find_reader, register, registered
from gmwm.files.readers.api import read, read_array, stream
from gmwm.files.readers.parts import Part
from gmwm.files.readers.streams import Stream
from gmwm.recording.chunks import Chunk

__all__ = [
    "MISSING", "Channel", "Chunk", "Layout", "Mark", "Part", "Reader", "Rows", "Stream", "find_reader", "read",
    "read_array", "register", "registered", "stream",
]  # fmt: skip
