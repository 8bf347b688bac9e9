"""Keeps what pure functions made of the last values that they were given."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable
from functools import wraps
from typing import TypeVar, TypeVarTuple

Given = TypeVarTuple("Given")
Made = TypeVar("Made")


_COMPARED: tuple[type[Hashable], ...] = (str, bool, int, frozenset)


def kept_for_same(most: int) -> Callable[[Callable[[*Given], Made]], Callable[[*Given], Made]]:
    """Lets a function answer from its `most` last results where it is given the same objects.

    A program, its stages and their plans never change, so the object decides the result: no value
    is compared, for a program is large, and 0.0 and -0.0 in it are equal and not the same. Words
    and numbers are compared. What raises is not kept.
    """

    def keeps(make: Callable[[*Given], Made]) -> Callable[[*Given], Made]:
        kept: OrderedDict[Hashable, tuple[tuple[object, ...], Made]] = OrderedDict()

        @wraps(make)
        def made(*given: *Given) -> Made:
            key = tuple(map(_key, given))
            # taken out and put back last: the order of the dictionary is that of the latest use
            found = kept.pop(key, None)
            if found is None:
                found = given, make(*given)  # what is given stays, and so does its identity
            kept[key] = found
            if len(kept) > most:
                kept.popitem(last=False)
            return found[1]

        return made

    return keeps


def _key(value: object) -> Hashable:
    return value if isinstance(value, _COMPARED) else ("same", id(value))
