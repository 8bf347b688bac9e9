"""Caches the sources of the latest kernels, so that a program is not lowered twice."""

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
"""Number of sources, some hundred kB each: training, standard errors and metrics need six."""


def kept_source(write: Callable[P, Source]) -> Callable[P, Source]:
    """Caches the latest results of a function, keyed by the text of its arguments.

    Equality would confuse 0.0 with -0.0; the `repr` of a dataclass does not. The key omits facts
    that do not affect the source, so programs that differ only in initial parameters share a
    source.
    """
    found: OrderedDict[bytes, Source] = OrderedDict()

    @wraps(write)
    def written(*args: P.args, **kwargs: P.kwargs) -> Source:
        said = repr((*map(_text, args), sorted(kwargs.items())))
        key = hashlib.sha256(said.encode()).digest()
        source = found.pop(key, None)
        if source is None:
            source = write(*args, **kwargs)
        # moved to the end: the oldest use is evicted first
        found[key] = source
        if len(found) > _KEPT:
            found.popitem(last=False)
        return source

    return written


@kept_for_same(_KEPT)
def _text(value: object) -> str:
    return repr(_said(value))


def _said(value: object) -> object:
    """An argument without the parts that do not affect the source."""
    if isinstance(value, Program):
        return replace(value, parameters=tuple(map(_any_value, value.parameters)), spec_hash="")
    if isinstance(value, Sensitivities):
        return replace(value, program=_said(value.program))
    return value


def _any_value(parameter: Parameter) -> Parameter:
    """Removes the initial value of a learned bounded parameter; others affect the analysis of
    derivatives.
    """
    bounded = parameter.minimum is not None or parameter.maximum is not None
    return replace(parameter, initial=()) if parameter.learn and bounded else parameter
