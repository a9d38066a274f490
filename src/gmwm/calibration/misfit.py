"""What a rejected model misses, in words: where its curve leaves that of the data, and what is read there."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gmwm.datasheets.bias import SYMBOL
from gmwm.processes.base import Process, registry
from gmwm.variance.slope_line import LAWS

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from gmwm.calibration.result import AxisCalibration
    from gmwm.datasheets import Datasheet
    from gmwm.processes import Model

LARGE = 1.5
"""Ratio of the model's variance to that of the data from which on the model does not describe the curve."""


def line_in(model: Model) -> str | None:
    """The name of a process of one frequency in a model; None where there is none."""
    return next((process.name for process in model.processes if _is_line(type(process))), None)


def _is_line(kind: type[Process]) -> bool:
    return kind.line is not Process.line


def _causes(rejected: Sequence[AxisCalibration]) -> str:
    """What may be the matter with axes whose model is rejected."""
    line = next((name for name, kind in registry.items() if _is_line(kind)), None)
    one, add = ("another", "add one more") if any(line_in(found.fit.model) for found in rejected) else ("a", "add")
    periodic = f"{one} periodic disturbance gives a curve with teeth: {add} {line} to `within`; " if line else ""
    return (
        f"look at the picture where a test rejects: {periodic}a change of temperature or a motion gives no curve of "
        "this kind; or `within` is too small, and a larger one has the term that is missing"
    )


@dataclass(frozen=True)
class Misfit:
    """Where the model is farthest from the data.

    Attributes
    ----------
    tau : float
        Scale (s).
    ratio : float
        The model's wavelet variance there over that of the data.
    """

    tau: float
    ratio: float

    @property
    def times(self) -> float:
        """The ratio, or 1 over it, whichever is above 1."""
        return max(self.ratio, 1 / self.ratio)


def misfit(found: AxisCalibration) -> Misfit | None:
    """The worst of the levels where the model lies outside the limits of the data; None where there is none.

    Levels that the test leaves out are not looked at: a few swings lie far off by chance.
    """
    wv = found.fit.wavelet_variance
    outside = (found.fit.implied < wv.lower) | (found.fit.implied > wv.upper)
    if found.test is not None:
        outside &= np.isin(wv.levels, found.test.levels)
    # A variance of zero has no ratio, and a model is never zero where its data are not.
    outside &= (wv.variance > 0) & (found.fit.implied > 0)
    if not np.any(outside):
        return None
    apart = np.zeros(len(wv))
    apart[outside] = np.abs(np.log(found.fit.implied[outside]) - np.log(wv.variance[outside]))
    worst = int(np.argmax(apart))
    return Misfit(float(wv.tau[worst]), float(found.fit.implied[worst] / wv.variance[worst]))


def undescribed(axes: Mapping[str, AxisCalibration]) -> dict[str, Misfit]:
    """Of axes whose recommended model a test rejects, those whose curve it does not even describe."""
    worst = {axis: misfit(found) for axis, found in axes.items()}
    return {axis: at for axis, at in worst.items() if at is not None and at.times > LARGE}


def about_rejected(axes: Mapping[str, AxisCalibration]) -> list[str]:
    """What to know of axes whose recommended model a test rejects."""
    far = undescribed(axes)
    near = [axis for axis in axes if axis not in far]
    said = []
    if near:
        said.append(
            f"{', '.join(near)}: the test rejects even the recommended model: some level is off by more than chance. "
            "The values still describe the curve, but may be off by several of their intervals: what a term that is "
            "missing made, others took"
        )
    for axis, at in far.items():
        said.append(
            f"{axis}: the test rejects even the recommended model, and it does not describe the curve: at {at.tau:.3g} "
            f"s its variance lies {at.times:.2g} times {'above' if at.ratio > 1 else 'below'} that of the data. "
            f"{_wrong(axes[axis], at.tau)}"
        )
    return [*said, _causes(list(axes.values()))] if said else []


def _wrong(found: AxisCalibration, tau: float) -> str:
    """The numbers that are read at scales like this one."""
    side = "long" if tau > _middle(found) else "short"
    names = _read_at(found.datasheet, side == "long")
    if not names:
        return f"The model tells nothing true of {side} scales"
    verb = "is" if len(names) == 1 else "are"
    return f"{' and '.join(names)}, which {verb} read at {side} scales, may be wrong"


def _read_at(sheet: Datasheet, long: bool) -> Sequence[str]:
    slopes = {str(symbol): law.slope for symbol, law in LAWS.items()}
    return [symbol for symbol in sheet if symbol in slopes and (slopes[symbol] >= 0) == long]


def _middle(found: AxisCalibration) -> float:
    """Where short scales end (s): at the bottom of the curve if it has one, else half way, as it is drawn."""
    bottom = found.datasheet.get(SYMBOL)
    wv = found.fit.wavelet_variance
    if bottom is not None and bottom.tau is not None and not bottom.upper_only:
        return 2 * bottom.tau  # a scale is two averaging times
    return math.sqrt(float(wv.tau[0] * wv.tau[-1]))
