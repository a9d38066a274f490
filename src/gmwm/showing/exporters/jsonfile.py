"""Base class of JSON formats. The verdict and the notes are lists under the keys "gmwm" and "gmwm_notes"."""

from __future__ import annotations

import json
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

from gmwm.showing.exporters.base import Noise, TwoNumbers
from gmwm.showing.exporters.text import commented, commented_notes, shortened

HEAD, NOTES = "gmwm", "gmwm_notes"
"""Keys of the head and of the notes. Programs ignore keys that they do not know."""


class JsonFile(TwoNumbers):
    """Base class of JSON formats with N and K of each sensor."""

    extension = ".json"
    head_first: ClassVar[bool] = True
    """Whether the verdict may be the first entry of the document."""

    @abstractmethod
    def content(self, noise: Noise) -> Mapping[str, Any]:
        """Return the JSON document without its head."""

    def body(self, noise: Noise) -> Sequence[str]:
        """Return the lines of the JSON document without its head."""
        return json.dumps(_rounded(self.content(noise)), indent=2).splitlines()

    def layout(self, head: Sequence[str], noise: Noise, notes: Sequence[str]) -> str:
        """Return the text of the JSON document with its head and its notes."""
        lines = {HEAD: commented(shortened(head), ""), NOTES: commented_notes(notes, "")}
        texts = {key: [line.strip() for line in each] for key, each in lines.items()}
        content = _rounded(self.content(noise))
        entries = (
            [(HEAD, texts[HEAD]), *content.items()] if self.head_first else [*content.items(), (HEAD, texts[HEAD])]
        )
        return json.dumps(dict([*entries, (NOTES, texts[NOTES])]), indent=2, allow_nan=False) + "\n"


def _rounded(value: Any) -> Any:
    """Round all numbers of a document to seven digits, as in the other formats."""
    if isinstance(value, Mapping):
        return {key: _rounded(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_rounded(item) for item in value]
    return float(f"{value:.7g}") if isinstance(value, float) else value
