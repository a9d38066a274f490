"""Pictures for the dark scheme of the site: the same picture with its lightness reversed and its hues kept."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from PIL import Image

BACKGROUND, FOREGROUND = "#131416", "#e8e8e8"
"""What white and black become: the page of furo in its dark scheme, and nearly white."""
VIVID = 1.6
"""Lightness that a colour gains per unit of chroma, so that coloured lines stand out from a dark page."""

# B. Ottosson (2020), A perceptual color space for image processing.
TO_CONES = np.array(
    [
        [0.4122214708, 0.5363325363, 0.0514459929],
        [0.2119034982, 0.6806995451, 0.1073969566],
        [0.0883024619, 0.2817188376, 0.6299787005],
    ]
)
TO_LAB = np.array(
    [
        [0.2104542553, 0.7936177850, -0.0040720468],
        [1.9779984951, -2.4285922050, 0.4505937099],
        [0.0259040371, 0.7827717662, -0.8086757660],
    ]
)

COLOUR = re.compile(r"#[0-9a-f]{6}\b", re.IGNORECASE)


def rgb(colour: str) -> np.ndarray:
    """Red, green and blue from 0 to 1 of `#rrggbb`."""
    return np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)]) / 255


def lab(colours: np.ndarray) -> np.ndarray:
    """Lightness and the two opponent colours (OKLab) of colours (..., 3) in sRGB."""
    linear = np.where(colours <= 0.04045, colours / 12.92, ((colours + 0.055) / 1.055) ** 2.4)
    return np.cbrt(linear @ TO_CONES.T) @ TO_LAB.T


def dark(colours: np.ndarray) -> np.ndarray:
    """Colours (..., 3) in sRGB, from 0 to 1, as they are on a dark page."""
    values = lab(colours)
    neutral = values * (0, 1, 1)
    neutral += lab(rgb(FOREGROUND)) + (lab(rgb(BACKGROUND)) - lab(rgb(FOREGROUND))) * values[..., :1]
    neutral[..., 0] += VIVID * np.hypot(values[..., 1], values[..., 2])
    linear = (((neutral @ np.linalg.inv(TO_LAB).T) ** 3) @ np.linalg.inv(TO_CONES).T).clip(0, 1)
    return np.where(linear <= 0.0031308, linear * 12.92, 1.055 * linear ** (1 / 2.4) - 0.055).clip(0, 1)


def dark_svg(text: str) -> str:
    """A drawing of Matplotlib. What names no colour is black in it."""

    def darker(match: re.Match[str]) -> str:
        return "#" + "".join(f"{round(255 * value):02x}" for value in dark(rgb(match[0])))

    black = COLOUR.sub(darker, "#000000")
    return COLOUR.sub(darker, text).replace("<svg ", f'<svg fill="{black}" ', 1)


def write_dark(file: Path, target: Path) -> None:
    """Write the dark version of a picture (.svg or .png)."""
    if file.suffix == ".svg":
        target.write_text(dark_svg(file.read_text(encoding="utf-8")), encoding="utf-8")
        return
    with Image.open(file) as picture:
        if picture.mode == "P":
            palette = np.array(picture.getpalette("RGB")).reshape(-1, 3) / 255
            picture.putpalette((255 * dark(palette)).round().astype(np.uint8).tobytes())
            picture.save(target)
        else:
            pixels = np.asarray(picture.convert("RGB")) / 255
            Image.fromarray((255 * dark(pixels)).round().astype(np.uint8)).save(target)
