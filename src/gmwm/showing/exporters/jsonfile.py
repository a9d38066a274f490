"""Base class of JSON formats. JSON has no comments, so the head is a list under the key "gmwm" at the end."""

from __future__ import annotations

import json
import textwrap
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from gmwm.showing.exporters.base import ExportOptions, Noise, TwoNumbers
from gmwm.showing.exporters.text import plain

if TYPE_CHECKING:
    from gmwm.calibration import Calibration

HEAD = "gmwm"
"""Key of the head. Programs ignore keys that they do not know."""
_WIDTH = 100
_DIGITS = 7


class JsonFile(TwoNumbers):
    """Base class of JSON formats with N and K of each sensor."""

    extension = ".json"

    @abstractmethod
    def content(self, noise: Noise) -> Mapping[str, Any]:
        """Return the JSON document without its head."""

    def body(self, noise: Noise) -> Sequence[str]:
        """Return the lines of the JSON document without its head."""
        return json.dumps(_rounded(self.content(noise)), indent=2).splitlines()

    def export(self, calibration: Calibration, options: ExportOptions) -> str:
        """Return the text of the JSON document with its head."""
        noise = self._noise(calibration, options)
        head = [line for text in self.head(calibration, noise) for line in textwrap.wrap(plain(text), _WIDTH)]
        return json.dumps({**_rounded(self.content(noise)), HEAD: head}, indent=2, allow_nan=False) + "\n"


def _rounded(value: Any) -> Any:
    """Round all numbers of a document to seven digits, as in the other formats."""
    if isinstance(value, Mapping):
        return {key: _rounded(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_rounded(item) for item in value]
    return float(f"{value:.{_DIGITS}g}") if isinstance(value, float) else value
