"""Draws records in which one sample is out of order: each tries one check of `reset`."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from backends.c.selftest.vectors.drawn_inputs import (
    DrawnRecord,
    StartPoint,
    beside,
    drawable,
    drawn_record,
)
from backends.c_language.literals import Dtype
from compiler.ir.liveness import extents
from compiler.ir.program import Program

Limits = tuple[float, float]


def drawn_starts(
    program: Program, random: np.random.Generator, dtype: Dtype, unroll: int
) -> Iterator[DrawnRecord]:
    """Records around t0: all at the lower limits, all at the upper ones, then one sample outside.

    Of signals with up to `unroll` numbers each is outside once in every way, as generated C has a
    statement for each. Of others the first, the last and one between take turns, as it has a loop.
    """
    ranges = {state.name: state.range for state in program.states}
    reads = extents(program.start, log=True)
    limits = {
        name: [known for known in (program.signal(name).range, ranges.get(name)) if known]
        for name in reads
    }
    for end in (0, 1):
        record = drawn_record(program, random, StartPoint(), dtype)
        for name, series in record.log.items():
            # at a limit and not beyond: what is in order must not be reported
            series[:] = _common(limits[name])[end]
        yield record
    for name, extent in reads.items():
        size = math.prod(axis.size for axis in program.signal(name).axes)
        count = size * (extent.last - extent.first + 1)
        for turn, value in enumerate(_invalid(limits[name], dtype)):
            for element in _elements(count, unroll, turn):
                record = drawn_record(program, random, StartPoint(), dtype)
                for other, series in record.log.items():
                    # all else in order, so that the status tells of one check alone
                    np.clip(series, *_common(limits[other]), out=series)
                begin = size * (record.t0 + extent.first)
                record.log[name].reshape(-1)[begin + element] = value
                yield record


def _common(limits: list[Limits]) -> Limits:
    """Finite limits that are inside all of these."""
    low = max((low for low, _ in limits), default=-math.inf)
    high = min((high for _, high in limits), default=math.inf)
    return drawable((low, high))


def _invalid(limits: list[Limits], dtype: Dtype) -> list[float]:
    """Values that checks must see: next to a limit, NaN, and infinite where nothing bounds."""
    found = [value for known in limits for value in beside(known, dtype)]
    bounded = all(any(math.isfinite(known[end]) for known in limits) for end in (0, 1))
    return [*found, math.nan, *(() if bounded else (math.inf, -math.inf))]


def _elements(count: int, unroll: int, turn: int) -> list[int]:
    if count <= unroll:
        return list(range(count))
    return [(0, count - 1, count // 2)[turn % 3]]
