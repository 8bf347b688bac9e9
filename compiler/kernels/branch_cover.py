"""Chooses test arguments for which a kernel takes both sides of each branch."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cache
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from compiler.kernels.table import routine
from compiler.kernels.tables.formats import RealName
from compiler.kernels.trace.run_routine import Outcome, run_routine
from compiler.kernels.trace.statements import (
    Assign,
    Binary,
    Block,
    Branch,
    Call,
    Constant,
    Routine,
    ValueKind,
    operation_operands,
)

Array = NDArray[Any]


@cache
def branch_cover(name: str, real: RealName) -> tuple[tuple[float, ...], ...]:
    """A small set of arguments of the kernel `name` in the format `real` that together take both
    sides of its branches, as far as any candidate does. Each element is one tuple of arguments.

    Candidates are at, below and above every constant of a comparison, across all exponents, and
    infinity and NaN.
    """
    traced = routine(name, real)
    candidates = _candidates(traced)
    points = np.array(list(product(candidates, repeat=len(traced.parameters))), candidates.dtype)
    outcomes = _outcomes(traced, points)
    chosen: list[int] = []
    # greedy set cover: the next point reaches most of the remaining outcomes
    while outcomes.shape[0]:
        # the first of equal ones, so that simple numbers are preferred
        best = int(np.argmax(outcomes.sum(axis=0)))
        chosen.append(best)
        outcomes = outcomes[~outcomes[:, best]]
    return (*(tuple(float(x) for x in points[index]) for index in chosen), *_BESIDES.get(name, ()))


_BESIDES = {"pow": ((-math.inf, 1.5),)}
"""Additional arguments: the C code moves the selection of pow's sign into a branch, which adds an
outcome."""


def _outcomes(traced: Routine, points: Array) -> NDArray[np.bool_]:
    """A boolean array (outcomes, points), with two outcomes per condition of the routine `traced`:
    True where a point of `points`, an array (points, arguments), has the outcome. Outcomes that no
    point has are omitted.
    """
    reached: dict[Outcome, NDArray[np.bool_]] = {}

    def note(outcome: Outcome, elements: NDArray[np.bool_]) -> None:
        before = reached.get(outcome)
        reached[outcome] = elements if before is None else before | elements

    run_routine(traced, tuple(points.T), note)
    rows = [row for row in reached.values() if row.any()]
    return np.array(rows).reshape(len(rows), len(points))


def _candidates(traced: Routine) -> Array:
    """The candidate values for each argument of the routine `traced`, an array of its format.
    Simple numbers come first, so that they are preferred among equally good ones.
    """
    dtype = traced.format.dtype
    limits = np.finfo(dtype)
    compared = np.array(sorted(set(_compared(traced.body))), dtype)
    with np.errstate(all="ignore"):
        beside = [compared, np.nextafter(compared, dtype.type(-np.inf))]
        beside.append(np.nextafter(compared, dtype.type(np.inf)))
    powers = 2.0 ** np.arange(limits.minexp, limits.maxexp, limits.maxexp // 18)
    sizes = np.concatenate(
        [
            np.array([0.3, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0, 4.0, 7.3], dtype),
            (1.37 * powers).astype(dtype),
            *beside,
            np.array([0.0, limits.smallest_subnormal, limits.tiny, limits.max], dtype),
            np.array([np.inf, np.nan], dtype),
        ]
    )
    return np.concatenate([sizes, -sizes])


def _compared(block: Block) -> Iterator[float]:
    """The real constants that occur in comparisons of the block's statements, also in called
    subroutines and in branches.
    """
    for statement in block.statements:
        match statement:
            case Assign(target, Binary() as operation) if target.kind is ValueKind.TRUTH:
                for operand in operation_operands(operation):
                    if isinstance(operand, Constant) and operand.kind is ValueKind.REAL:
                        yield float(operand.value)
            case Call(_, called, _):
                yield from _compared(called.body)
            case Branch(_, _, then, otherwise):
                yield from _compared(then)
                yield from _compared(otherwise)
            case _:
                pass
