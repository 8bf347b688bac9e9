"""Keeps the sources of kernels that were written last, so that a program is not lowered twice."""

from __future__ import annotations

import hashlib
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import replace
from functools import wraps
from typing import ParamSpec, TypeVar

from compiler.differentiation.sensitivities import Sensitivities
from compiler.ir.kept_results import kept_for_same
from compiler.ir.program import Parameter, Program

P = ParamSpec("P")
Source = TypeVar("Source")

_KEPT = 16
"""Some hundred kB each: a training, its standard errors and what is measured of it make six."""


def kept_source(write: Callable[P, Source]) -> Callable[P, Source]:
    """The function, its last results kept by the text of its arguments.

    Text, for programs with 0.0 and with -0.0 are equal and not the same; the `repr` of a dataclass
    has all that is in it. What no kernel says is left out: programs that differ in first values of
    parameters alone share one.
    """
    found: OrderedDict[bytes, Source] = OrderedDict()

    @wraps(write)
    def written(*args: P.args, **kwargs: P.kwargs) -> Source:
        said = repr((*map(_text, args), sorted(kwargs.items())))
        key = hashlib.sha256(said.encode()).digest()
        source = found.pop(key, None)
        if source is None:
            source = write(*args, **kwargs)
        # to the end: what was asked for last goes last
        found[key] = source
        if len(found) > _KEPT:
            found.popitem(last=False)
        return source

    return written


@kept_for_same(_KEPT)
def _text(value: object) -> str:
    return repr(_said(value))


def _said(value: object) -> object:
    """An argument without what its source cannot have."""
    if isinstance(value, Program):
        return replace(value, parameters=tuple(map(_any_value, value.parameters)), spec_hash="")
    if isinstance(value, Sensitivities):
        return replace(value, program=_said(value.program))
    return value


def _any_value(parameter: Parameter) -> Parameter:
    """Learned within bounds, whatever it begins with; else slopes are judged where it begins."""
    bounded = parameter.minimum is not None or parameter.maximum is not None
    return replace(parameter, initial=()) if parameter.learn and bounded else parameter
