"""Writes golden Jacobians as C, which compares the entries with the interpreter's."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.c.interface.interface import Interface
from backends.c.interface.jacobian_interface import OUT, JacobianInterface, MatrixField
from backends.c.interface.status import StatusBit
from backends.c.selftest.matrix_checksums import START, checksums
from backends.c.selftest.text.golden_text import tolerance
from backends.c.selftest.vectors.golden_vectors import GoldenVectors, joined
from backends.c_language.places import variable
from backends.c_language.scope import BlockScope, LocalNames
from backends.c_language.tree import (
    Argument,
    Assign,
    Binary,
    Call,
    ConstantTable,
    CType,
    Declare,
    Discard,
    Element,
    Expression,
    Function,
    If,
    Name,
    Real,
    Return,
    Truth,
    Unsigned,
)


def slopes_function(
    interface: Interface, jacobian: JacobianInterface, runs: Sequence[GoldenVectors]
) -> Function:
    """`<prefix>_slopes_differ(status, jac, step)`: whether linearize answered something else.

    Where bits are promised a hash of all entries is compared. Else numbers are, where there are
    many of them those of every n-th step.
    """
    golden, prefix = joined(runs), interface.prefix
    scope = BlockScope(LocalNames(prefix))
    scope.reserve(OUT)
    bits = [
        float((status & ~_OF_RESULTS) | infinite)
        for status, infinite in zip(
            golden.status.tolist(), _infinite(jacobian, golden.slopes).tolist(), strict=True
        )
    ]
    scope.add(ConstantTable("golden_status", tuple(bits), CType.UNSIGNED))
    expected = Element(Name("golden_status"), Name("step"))
    scope.add(Declare(CType.BOOL, "differ", Binary("!=", Name("status"), expected)))
    if not jacobian.fields:
        scope.add(Discard(OUT))
    elif interface.options.is_exact:
        _compare_hashes(prefix, jacobian, golden, scope)
    else:
        _compare_numbers(interface, jacobian, golden, scope)
    scope.add(Return(Name("differ")))
    arguments = (
        Argument(f"{prefix}_status_t", "status"),
        Argument(f"const {prefix}_jacobian_t *", OUT),
        Argument("uint32_t", "step"),
    )
    body = tuple(scope.statements)
    return Function(
        name=f"{prefix}_slopes_differ", result="bool", arguments=arguments, body=body, static=True
    )


def _compare_hashes(
    prefix: str, jacobian: JacobianInterface, golden: GoldenVectors, scope: BlockScope
) -> None:
    hash = Name(scope.fresh("hash"))
    scope.add(
        ConstantTable("golden_hash", tuple(map(float, checksums(golden.slopes))), CType.UNSIGNED)
    )
    scope.add(Declare(CType.UNSIGNED, hash.text, Unsigned(START)))
    for field in jacobian.fields:
        with scope.loop(field.matrix.size) as (index, inner):
            number = field.place.element([index])
            inner.add(Assign(hash, Call(f"{prefix}_hashed", (hash, number))))
    expected = Element(Name("golden_hash"), Name("step"))
    scope.add(If(Binary("!=", hash, expected), (Assign(Name("differ"), Truth(True)),)))


def _compare_numbers(
    interface: Interface, jacobian: JacobianInterface, golden: GoldenVectors, scope: BlockScope
) -> None:
    scope.reserve(_ROW)
    every = _distance(jacobian, len(golden.status))
    inner = scope.inner()
    for field in jacobian.fields:
        _compare(interface, field, golden.slopes[field.matrix.name][::every], inner)
    row = Binary("/", Name("step"), Unsigned(every))
    scope.add(Declare(CType.UNSIGNED, _ROW, row, constant=True))
    chosen = Binary("==", Binary("*", Name(_ROW), Unsigned(every)), Name("step"))
    scope.add(If(chosen, tuple(inner.statements)))


def _infinite(jacobian: JacobianInterface, slopes: Mapping[str, NDArray[Any]]) -> NDArray[Any]:
    """For every step the bit that linearize sets where a slope is infinite."""
    found: NDArray[Any] = np.zeros(len(next(iter(slopes.values()), ())), bool)
    for field in jacobian.fields:
        entries = slopes[field.matrix.name].reshape(len(found), -1)
        for block in field.matrix.perhaps_infinite:
            places = block.places(jacobian.jacobian.graph[block.node].type.shape).ravel()
            found = found | ~np.isfinite(entries[:, places]).all(axis=1)
    return found * int(StatusBit.SLOPE_NOT_FINITE)


_OF_RESULTS = int(
    StatusBit.STATE_OUT_OF_RANGE | StatusBit.EQUATION_OUT_OF_RANGE | StatusBit.STATE_NOT_FINITE
)
"""Bits that are about what a step computes."""
_ROW = "row"
_MOST_NUMBERS = 16384
"""Of golden slopes in one table: what a small microcontroller has room for."""


def _distance(jacobian: JacobianInterface, steps: int) -> int:
    """From one step whose slopes are compared number by number to the next."""
    computed = sum(field.matrix.known.count(None) for field in jacobian.fields)
    return max(1, -(-computed * steps // _MOST_NUMBERS))


def _compare(
    interface: Interface, field: MatrixField, golden: NDArray[Any], scope: BlockScope
) -> None:
    """All entries in a loop: those that are computed with the step's row of a table."""
    matrix, name = field.matrix, field.identifier
    steps = len(golden)
    computed = [i for i, known in enumerate(matrix.known) if known is None]
    numbers = golden.reshape(steps, matrix.size)[:, computed]
    table, places, constants = (f"{kind}_{name}" for kind in ("golden", "computed", "known"))
    count = len(computed)
    if computed:
        scope.add(ConstantTable(table, tuple(numbers.ravel().tolist()), hexadecimal=True))
    zero: Expression = Real(0.0)
    some = any(matrix.known)
    if some:
        known = tuple(0.0 if number is None else number for number in matrix.known)
        scope.add(ConstantTable(constants, known, hexadecimal=True))
    every = count == matrix.size
    reached = f"reached_{name}"
    if computed and not every:
        scope.add(ConstantTable(places, tuple(map(float, computed)), CType.UNSIGNED))
        scope.add(Declare(CType.UNSIGNED, reached, Unsigned(0)))
    with scope.loop(matrix.size) as (index, inner):
        at = index.expression()
        row = variable(_ROW).times(count)
        expected: Expression = Element(Name(constants), at) if some else zero
        if every:
            expected = Element(Name(table), row.plus(index).expression())
        elif computed:
            inner.add(Declare(CType.REAL, "expected", expected))
            expected = Name("expected")
            left = Binary("<", Name(reached), Unsigned(count))
            here = Binary("==", Element(Name(places), Name(reached)), at)
            number = Element(Name(table), row.plus(variable(reached)).expression())
            onward = Assign(Name(reached), Binary("+", Name(reached), Unsigned(1)))
            inner.add(If(Binary("&&", left, here), (Assign(expected, number), onward)))
        given = field.place.element([index])
        allowed = Real(tolerance(interface, golden))
        differs = Call(f"{interface.prefix}_differs", (given, expected, allowed))
        inner.add(If(differs, (Assign(Name("differ"), Truth(True)),)))
