"""Model selection: rank candidate models by an information criterion, with its uncertainty."""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gmwm.choosing.selection.api import rank, select
    from gmwm.choosing.selection.ranking import Candidate, Comparison, Ranking

__all__ = ["Candidate", "Comparison", "Ranking", "rank", "select"]


def __getattr__(name: str) -> object:
    """Import a name when it is used."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{'ranking' if name[0].isupper() else 'api'}"), name)
