"""Caches the latest results of pure functions, by the identity of their arguments."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable
from functools import wraps
from typing import TypeVar, TypeVarTuple

Given = TypeVarTuple("Given")
Made = TypeVar("Made")


_COMPARED: tuple[type[Hashable], ...] = (str, bool, int, frozenset)


def kept_for_same(most: int) -> Callable[[Callable[[*Given], Made]], Callable[[*Given], Made]]:
    """Decorates a function so that its `most` latest results are cached. A call with the same
    arguments returns the cached object.

    An argument counts as the same if it is the identical object, since programs, stages and plans
    are immutable. Comparing their values would be slow, and would confuse 0.0 with -0.0. Strings,
    booleans, integers and frozensets are compared by value. Exceptions are not cached.
    """

    def keeps(make: Callable[[*Given], Made]) -> Callable[[*Given], Made]:
        cache: OrderedDict[Hashable, tuple[tuple[object, ...], Made]] = OrderedDict()

        @wraps(make)
        def made(*arguments: *Given) -> Made:
            key = tuple(map(_key, arguments))
            # removed and added at the end: the dictionary is ordered by the latest use
            entry = cache.pop(key, None)
            if entry is None:
                # the stored reference keeps the arguments alive: no other object gets their ids
                entry = arguments, make(*arguments)
            cache[key] = entry
            if len(cache) > most:
                cache.popitem(last=False)
            return entry[1]

        return made

    return keeps


def _key(value: object) -> Hashable:
    return value if isinstance(value, _COMPARED) else ("same", id(value))
