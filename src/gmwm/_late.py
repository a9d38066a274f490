"""Methods of a result whose code is in a higher layer, found when they are first called."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from inspect import Signature, signature
from types import MethodType
from typing import Any, Generic, ParamSpec, TypeVar, overload

P = ParamSpec("P")
R = TypeVar("R")


class LateMethod(Generic[P, R]):
    """A method bound on first use to the function `target`, written "module:function".

    The function takes the object as its first argument. Nothing is imported until it is called, so a
    result offers `plot()` while its own module imports no plotting library. Of an object it is a method like any
    other, with the function's signature and words.
    """

    def __init__(self, target: str, doc: str) -> None:
        self.target = target
        self.__doc__ = doc

    def resolve(self) -> Callable[..., R]:
        """The function itself."""
        module, _, name = self.target.partition(":")
        function: Callable[..., R] = getattr(import_module(module), name)
        return function

    @overload
    def __get__(self, instance: None, owner: type) -> LateMethod[P, R]: ...
    @overload
    def __get__(self, instance: object, owner: type) -> Callable[P, R]: ...
    def __get__(self, instance: object | None, owner: type) -> Any:
        if instance is None:
            return self
        return MethodType(self.resolve(), instance)

    def __call__(self, *args: Any, **kwargs: Any) -> R:
        """Of a class: the function, called with an object first."""
        return self.resolve()(*args, **kwargs)

    @property
    def __signature__(self) -> Signature:
        return signature(self.resolve())


class LateProperty(Generic[R]):
    """What the function `target`, written "module:function", makes of the object: computed once, when asked for."""

    def __init__(self, target: str, doc: str) -> None:
        self._method: LateMethod[[], R] = LateMethod(target, doc)
        self.target = target
        self.__doc__ = doc

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    def resolve(self) -> Callable[..., R]:
        """The function itself."""
        return self._method.resolve()

    @overload
    def __get__(self, instance: None, owner: type) -> LateProperty[R]: ...
    @overload
    def __get__(self, instance: object, owner: type) -> R: ...
    def __get__(self, instance: object | None, owner: type) -> Any:
        if instance is None:
            return self
        # In the object's own dictionary, which is looked at before this is: frozen classes have one too.
        value = instance.__dict__[self.name] = self.resolve()(instance)
        return value
