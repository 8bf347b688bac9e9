"""Draws records with one invalid sample: each tests one check of `reset`."""

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
from compiler.ir.nodes import extents
from compiler.ir.program import Program

Limits = tuple[float, float]


def drawn_starts(
    program: Program, random: np.random.Generator, dtype: Dtype, unroll: int
) -> Iterator[DrawnRecord]:
    """Records around t0: one at all lower limits, one at all upper limits, then one sample outside.

    In signals of up to `unroll` elements each element is invalid once in every way, because
    generated C has a statement for each. In larger signals, which C checks in a loop, only the
    first, last and middle element take turns.
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
            # exactly at a limit: `reset` must not report valid samples
            series[:] = _common(limits[name])[end]
        yield record
    for name, extent in reads.items():
        size = math.prod(axis.size for axis in program.signal(name).axes)
        count = size * (extent.last - extent.first + 1)
        for turn, value in enumerate(_invalid(limits[name], dtype)):
            for element in _elements(count, unroll, turn):
                record = drawn_record(program, random, StartPoint(), dtype)
                for other, series in record.log.items():
                    # all other samples are valid, so that the status shows this check alone
                    np.clip(series, *_common(limits[other]), out=series)
                begin = size * (record.t0 + extent.first)
                record.log[name].reshape(-1)[begin + element] = value
                yield record


def _common(limits: list[Limits]) -> Limits:
    """Finite limits of the intersection of these ranges."""
    low = max((low for low, _ in limits), default=-math.inf)
    high = min((high for _, high in limits), default=math.inf)
    return drawable((low, high))


def _invalid(limits: list[Limits], dtype: Dtype) -> list[float]:
    """Values that a check must reject: next to each limit, NaN, and ±inf if a side has no limit."""
    found = [value for known in limits for value in beside(known, dtype)]
    bounded = all(any(math.isfinite(known[end]) for known in limits) for end in (0, 1))
    return [*found, math.nan, *(() if bounded else (math.inf, -math.inf))]


def _elements(count: int, unroll: int, turn: int) -> list[int]:
    if count <= unroll:
        return list(range(count))
    return [(0, count - 1, count // 2)[turn % 3]]
