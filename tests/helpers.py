"""What many tests share: remarks by their codes, errors by their data."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from gmwm.errors import GmwmError
from gmwm.remarks import Remark


def codes(remarks: Iterable[Remark]) -> list[str]:
    """The codes of remarks, in their order."""
    return [remark.code for remark in remarks]


def only(remarks: Iterable[Remark], code: str) -> Remark:
    """The one remark of a code."""
    found = [remark for remark in remarks if remark.code == code]
    assert len(found) == 1, f"{len(found)} remarks of {code} among {codes(remarks)}"
    return found[0]


@contextmanager
def raises(kind: type[GmwmError], **expected: Any) -> Iterator[pytest.ExceptionInfo[GmwmError]]:
    """An error of this kind whose attributes (`argument`, `got`, …) or facts are these."""
    with pytest.raises(kind) as caught:
        yield caught
    error = caught.value
    for name, value in expected.items():
        found = getattr(error, name) if hasattr(error, name) else error.facts[name]
        assert found == value, f"{name} is {found!r}, expected {value!r}"
