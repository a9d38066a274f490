"""Logo, icon of the browser's tab, and the card that other programs show for a link to the site."""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patches import FancyBboxPatch

from gmwm.showing.plots.style import BLUE

BAND = "#9fd3f5"

STATIC = Path(__file__).parents[1] / "_static"
SIDE = 64
"""Side of the logo, in its own units."""
LINES = "Noise models of inertial sensors,", "from a recording at rest to the file of a filter"


def allan() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """An Allan deviation and the half-width of its limits, as points in the square of the logo; y is down."""
    octaves = np.linspace(0, 10, 41)
    variance = 2.0**-octaves + 0.022 + 2.0 ** (octaves - 13.2)
    width = 0.1 * 2.0 ** (octaves / 2.6)
    return 9 + 46 * octaves / 10, 12 - 8.6 * np.log2(variance), 11 * width


def drawing(stroke: float, details: bool) -> str:
    """A blue tile with the curve, and with its limits and estimates."""
    x, y, half = allan()
    line = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))
    parts = [f'<rect width="{SIDE}" height="{SIDE}" rx="13" fill="{BLUE}"/>']
    if details:
        ends = zip([*x, *x[::-1]], [*(y - half), *(y + half)[::-1]], strict=True)
        band = " ".join(f"{a:.1f},{min(max(b, 5), SIDE - 5):.1f}" for a, b in ends)
        parts.append(f'<polygon points="{band}" fill="{BAND}" fill-opacity="0.6"/>')
    style = f'fill="none" stroke="#ffffff" stroke-width="{stroke}" stroke-linecap="round" stroke-linejoin="round"'
    parts.append(f'<polyline points="{line}" {style}/>')
    if details:
        parts += [
            f'<circle cx="{a:.1f}" cy="{b:.1f}" r="3.6" fill="#ffffff"/>' for a, b in zip(x[::8], y[::8], strict=True)
        ]
    box = f'viewBox="0 0 {SIDE} {SIDE}" width="{SIDE}" height="{SIDE}"'
    return f'<svg xmlns="http://www.w3.org/2000/svg" {box}>\n' + "\n".join(parts) + "\n</svg>\n"


def draw_card(path: Path) -> None:
    """1200 by 630 dots, which Slack, Mastodon and others show: the logo, the name, and what gmwm does."""
    figure = plt.figure(figsize=(12, 6.3), dpi=100, facecolor="white")
    page = figure.add_axes((0, 0, 1, 1), xlim=(0, 1200), ylim=(630, 0))
    page.set_axis_off()
    page.add_patch(FancyBboxPatch((100, 120), 220, 220, "round,pad=0,rounding_size=44", color=BLUE, linewidth=0))
    scale = 220 / SIDE
    x, y, half = (scale * values for values in allan())
    page.fill_between(
        100 + x, 120 + np.maximum(y - half, 17), 120 + np.minimum(y + half, 203), color=BAND, alpha=0.6, lw=0
    )
    page.plot(100 + x, 120 + y, color="white", lw=10, solid_capstyle="round")
    page.plot(100 + x[::8], 120 + y[::8], "o", color="white", ms=17)
    page.text(370, 230, "gmwm", fontsize=110, fontweight="bold", color="#1a1a1a", va="center")
    for row, line in enumerate(LINES):
        page.text(100, 430 + 62 * row, line, fontsize=31, color="#404040", va="center")
    figure.savefig(path, dpi=100)
    plt.close(figure)


def write(folder: Path) -> list[Path]:
    """All three beside the other static files of the site."""
    logo, icon, card = STATIC / "logo.svg", STATIC / "icon.svg", STATIC / "card.png"
    logo.write_text(drawing(4, True), encoding="utf-8")
    icon.write_text(drawing(8, False), encoding="utf-8")
    draw_card(card)
    return [logo, icon, card]
