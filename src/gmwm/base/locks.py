"""Make methods safe to call from several threads: only one call on an object runs at a time."""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import wraps
from typing import TYPE_CHECKING, Any, Concatenate, ParamSpec, TypeVar

if TYPE_CHECKING:
    from typing_extensions import Self

P = ParamSpec("P")
R = TypeVar("R")


class OneAtATime:
    """Base of classes with methods marked by `one_at_a_time`; each object has its own lock, which is not pickled."""

    _lock: threading.RLock

    def __new__(cls, *_args: Any, **_options: Any) -> Self:
        """Make an object with a lock, also when it is restored from a pickle."""
        instance = super().__new__(cls)
        instance._lock = threading.RLock()
        return instance

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "_lock"}


S = TypeVar("S", bound=OneAtATime)


def one_at_a_time(method: Callable[Concatenate[S, P], R]) -> Callable[Concatenate[S, P], R]:
    """Decorate a method so that a call waits until the calls of other threads on the same object have ended."""

    @wraps(method)
    def call(self: S, /, *args: P.args, **options: P.kwargs) -> R:
        with self._lock:
            return method(self, *args, **options)

    return call
