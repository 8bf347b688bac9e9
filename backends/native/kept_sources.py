"""Keeps the sources of kernels that were written last, so that a program is not lowered twice."""

from __future__ import annotations

import hashlib
from collections import OrderedDict
from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
Source = TypeVar("Source")

_KEPT = 16
"""Some hundred kB each: a training, its standard errors and what is measured of it make six."""


def kept_source(write: Callable[P, Source]) -> Callable[P, Source]:
    """The function, its last results kept by the text of its arguments.

    Text, for programs with 0.0 and with -0.0 are equal and not the same; the `repr` of a dataclass
    has all that is in it.
    """
    found: OrderedDict[bytes, Source] = OrderedDict()

    @wraps(write)
    def written(*args: P.args, **kwargs: P.kwargs) -> Source:
        key = hashlib.sha256(repr((args, sorted(kwargs.items()))).encode()).digest()
        source = found.pop(key, None)
        if source is None:
            source = write(*args, **kwargs)
        found[key] = source
        if len(found) > _KEPT:
            found.popitem(last=False)
        return source

    return written
