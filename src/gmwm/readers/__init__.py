"""Readers of recordings: one file a format, one front door, `read`.

>>> [reader.name for reader in registered()]
['parquet', 'text']
"""

from gmwm.readers import parquet as parquet
from gmwm.readers import text as text
from gmwm.readers.base import Channel, Chunk, Layout, Reader, find_reader, register, registered
from gmwm.readers.recording import read

__all__ = ["Channel", "Chunk", "Layout", "Reader", "find_reader", "read", "register", "registered"]
