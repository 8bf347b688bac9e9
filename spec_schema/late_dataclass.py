"""Dataclasses whose methods are written when a class is first used, not when its file is imported.

The standard library writes and compiles six functions for a class. A command imports many classes
that it makes no object of, and makes objects of many that it never compares or prints: for a small
spec those functions took a quarter of `msnn check`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from threading import RLock
from types import MethodType
from typing import Any, ClassVar, TypeVar, cast, dataclass_transform, get_origin

_Class = TypeVar("_Class", bound=type)
_FOR_MAKING = ("__dataclass_fields__", "__match_args__", "__init__")
"""Dataclass members that most classes need, without comparison and printing."""
_OF_OPTION = {
    "repr": ("__repr__",),
    "eq": ("__eq__",),
    "order": ("__lt__", "__le__", "__gt__", "__ge__"),
    "frozen": ("__setattr__", "__delattr__"),
}
_PLACES = ("__dict__", "__weakref__")
_WRITING = RLock()  # the standard library refuses a class that another thread has half written


@dataclass_transform(field_specifiers=(dataclasses.field,))
def dataclass(
    *,
    frozen: bool = False,
    slots: bool = False,
    kw_only: bool = False,
    eq: bool = True,
    order: bool = False,
    repr: bool = True,
) -> Callable[[_Class], _Class]:
    """Like `dataclasses.dataclass`, but methods are generated on first use."""
    options = {"frozen": frozen, "kw_only": kw_only, "eq": eq, "order": order, "repr": repr}

    def late(written: _Class) -> _Class:
        return cast("_Class", _waiting(written, options, slots=slots))

    return late


def _waiting(written: type, options: Mapping[str, bool], *, slots: bool) -> type:
    """A class equivalent to the original, whose dataclass methods are generated at the
    first use.
    """
    content = dict(vars(written))
    own = _own_fields(content)
    for name in (*_PLACES, *own):
        content.pop(name, None)
    if slots:
        inherited = {name for base in written.__mro__ for name in vars(base).get("__slots__", ())}
        content["__slots__"] = tuple(name for name in own if name not in inherited)
        if options["frozen"]:
            content.setdefault("__getstate__", _state)
            content.setdefault("__setstate__", _set_state)
    unfinished = _Unfinished(written, options)
    asked = [name for option, names in _OF_OPTION.items() if options[option] for name in names]
    for name in (*_FOR_MAKING, "__dataclass_params__"):
        content.setdefault(name, _Unwritten(name, unfinished))
    for name in asked:
        content.setdefault(name, _unwritten_method(name, unfinished))
    if options["eq"] and options["frozen"] and content.get("__hash__") is None:
        content["__hash__"] = _unwritten_method("__hash__", unfinished)
    unfinished.made = _like(written, content)
    return unfinished.made


def _like(written: type, content: dict[str, Any]) -> type:
    """A class of the same name and bases."""
    made = type(written)(written.__name__, written.__bases__, content)
    made.__qualname__ = written.__qualname__
    return made


def _own_fields(content: Mapping[str, Any]) -> list[str]:
    annotations: Mapping[str, Any] = content.get("__annotations__", {})
    return [name for name, annotation in annotations.items() if not _is_of_class(annotation)]


def _is_of_class(annotation: Any) -> bool:
    if isinstance(annotation, str):
        return annotation.startswith("ClassVar")
    return get_origin(annotation) is ClassVar


def _state(self: Any) -> list[Any]:
    """The fields of an object for pickle and copy; a frozen object with slots needs this."""
    return [getattr(self, field.name) for field in dataclasses.fields(self)]


def _set_state(self: Any, state: Sequence[Any]) -> None:
    for field, value in zip(dataclasses.fields(self), state, strict=True):
        object.__setattr__(self, field.name, value)


class _Unfinished:
    """The original class, and the new class whose methods are generated later."""

    __slots__ = ("_content", "_has_all", "_has_init", "_is_new", "_options", "_written", "made")

    made: type

    def __init__(self, written: type, options: Mapping[str, bool]) -> None:
        self._written, self._options = written, options
        self._content = dict(vars(written))
        self._has_init = self._has_all = False
        self._is_new = True

    def write(self, name: str) -> None:
        """Lets the standard library do its work on the written class, and takes it over.

        First what makes objects, then all: its functions are compiled one by one.
        """
        with _WRITING:
            if self._has_all or (self._has_init and name in _FOR_MAKING):
                return
            if name in _FOR_MAKING:
                self._take_over(self._as_written(), _only_for_making(self._options))
                self._has_init = True
            else:
                self._take_over(self._as_written(), self._options)
                self._has_all = True

    def _take_over(self, written: type, options: Mapping[str, bool]) -> None:
        dataclasses.dataclass(**options)(written)
        left = {*_PLACES, *vars(written)["__dataclass_fields__"]}
        if options is not self._options:
            left.add("__dataclass_params__")  # those of what was asked of the library here
        for name, value in vars(written).items():
            if name not in left and self._content.get(name) is not value:
                # put over what waits there, so that no thread finds a class without it
                setattr(self.made, name, value)

    def _as_written(self) -> type:
        """The original class; another one after the standard library has processed it."""
        if self._is_new:
            self._is_new = False
            return self._written
        content = {name: value for name, value in self._content.items() if name not in _PLACES}
        return _like(self._written, content)


def _only_for_making(options: Mapping[str, bool]) -> dict[str, bool]:
    return {**options, "eq": False, "order": False, "repr": False}


def _unwritten_method(name: str, unfinished: _Unfinished) -> Callable[..., Any]:
    """A placeholder that generates the method when it is called."""

    def method(self: Any, *arguments: Any) -> Any:
        unfinished.write(name)
        return getattr(unfinished.made, name)(self, *arguments)

    return method


class _Unwritten:
    """A placeholder that generates the attribute when it is read."""

    __slots__ = ("_name", "_unfinished")

    def __init__(self, name: str, unfinished: _Unfinished) -> None:
        self._name, self._unfinished = name, unfinished

    def __get__(self, instance: object, owner: type) -> Any:
        self._unfinished.write(self._name)
        found = getattr(self._unfinished.made, self._name)
        return found if instance is None or not callable(found) else MethodType(found, instance)
