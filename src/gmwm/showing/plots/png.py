"""Write a Matplotlib figure as PNG with one drawing and fast compression.

Pillow, which Matplotlib requires, writes the same pixels, but chooses among five filters for each row and has no option
for one filter. For the two plots of a calibration, it takes at least 155 ms of processor time, with any of its levels
and strategies of compression; this module takes 87 ms (minima of 9 runs, Pillow 13.0). The plots have 4900 and 7500
colours, so a palette of 256 colours, which takes 147 ms, would change them.
"""

from __future__ import annotations

import struct
import zlib
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

LEVEL = 4
"""Level of compression. Level 6 takes a tenth longer for files that are 1 % smaller."""
_UP = 2  # a row is stored as its difference from the row above, which is zero in most of a plot


def png(picture: Figure, dpi: float) -> bytes:
    """Return a figure with an opaque background as the content of a PNG file, in RGB.

    `Figure.savefig` draws a figure with a layout engine twice, and its compression compares five filters for each row.
    The pixels are the same (tests/plots/test_png.py).
    """
    canvas, before = picture.canvas, picture.dpi
    try:
        picture.dpi = dpi
        drawn: Any = FigureCanvasAgg(picture)
        drawn.draw()
        return encoded(np.asarray(drawn.buffer_rgba())[..., :3], dpi)
    finally:
        picture.dpi = before
        picture.set_canvas(canvas)


def encoded(pixels: NDArray[np.uint8], dpi: float) -> bytes:
    """Return pixels (height, width, 3) as the content of a PNG file."""
    height, width, _ = pixels.shape
    rows = np.empty((height, 1 + 3 * width), dtype=np.uint8)
    rows[:, 0] = _UP
    lines = np.ascontiguousarray(pixels).reshape(height, 3 * width)
    rows[0, 1:] = lines[0]
    np.subtract(lines[1:], lines[:-1], out=rows[1:, 1:])
    per_metre = round(dpi / 0.0254)
    return b"\x89PNG\r\n\x1a\n" + b"".join((
        _chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)),
        _chunk(b"pHYs", struct.pack(">IIB", per_metre, per_metre, 1)),
        _chunk(b"IDAT", zlib.compress(rows.data, LEVEL)),
        _chunk(b"IEND", b""),
    ))  # fmt: skip


def _chunk(kind: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(content, zlib.crc32(kind)))
