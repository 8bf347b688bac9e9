"""Writes C that compares the Jacobian, and vectors of states, inputs and outputs, with golden
values.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.c.interface.interface import Interface
from backends.c.interface.jacobian_interface import OUT, JacobianInterface, MatrixField
from backends.c.interface.status import StatusBit
from backends.c.selftest.golden_tables import DIFFER
from backends.c.selftest.golden_text import START, checksums, tolerance
from backends.c.selftest.golden_vectors import GoldenVectors, joined
from backends.c_language import tree as c
from backends.c_language.places import variable
from backends.c_language.scope import BlockScope, LocalNames
from compiler.jacobian.matrices import Vector


def slopes_function(
    interface: Interface, jacobian: JacobianInterface, runs: Sequence[GoldenVectors]
) -> c.Function:
    """The C function `<prefix>_slopes_differ(status, jac, step)`: true if the status or the
    matrices of linearize at this golden step are wrong. If results must be exact, a hash of all
    entries is compared. Otherwise entries are compared by value; for large Jacobians only those of
    every n-th step.
    """
    golden, prefix = joined(runs), interface.prefix
    scope = BlockScope(LocalNames(prefix))
    scope.reserve(OUT)
    bits = [
        # linearize computes neither next states nor equations and cannot report on them
        float((status & ~_OF_RESULTS) | infinite)
        for status, infinite in zip(
            golden.status.tolist(), _infinite(jacobian, golden.slopes).tolist(), strict=True
        )
    ]
    scope.add(c.ConstantTable("golden_status", tuple(bits), c.CType.UNSIGNED))
    expected = c.Element(c.Name("golden_status"), c.Name("step"))
    scope.add(c.Declare(c.CType.BOOL, "differ", c.Binary("!=", c.Name("status"), expected)))
    if not jacobian.fields:
        scope.add(c.Discard(OUT))
    elif interface.options.is_exact:
        _compare_hashes(prefix, jacobian, golden, scope)
    else:
        _compare_numbers(interface, jacobian, golden, scope)
    scope.add(c.Return(c.Name("differ")))
    arguments = (
        c.Argument(f"{prefix}_status_t", "status"),
        c.Argument(f"const {prefix}_jacobian_t *", OUT),
        c.Argument("uint32_t", "step"),
    )
    return scope.function(f"{prefix}_slopes_differ", "bool", arguments)


def _compare_hashes(
    prefix: str, jacobian: JacobianInterface, golden: GoldenVectors, scope: BlockScope
) -> None:
    hash = c.Name(scope.fresh("hash"))
    scope.add(
        c.ConstantTable(
            "golden_hash", tuple(map(float, checksums(golden.slopes))), c.CType.UNSIGNED
        )
    )
    scope.add(c.Declare(c.CType.UNSIGNED, hash.text, c.Unsigned(START)))
    for field in jacobian.fields:
        with scope.loop(field.matrix.size) as (index, inner):
            number = field.place.element([index])
            inner.add(c.Assign(hash, c.Call(f"{prefix}_hashed", (hash, number))))
    expected = c.Element(c.Name("golden_hash"), c.Name("step"))
    scope.add(c.If(c.Binary("!=", hash, expected), (c.Assign(c.Name("differ"), c.Truth(True)),)))


def _compare_numbers(
    interface: Interface, jacobian: JacobianInterface, golden: GoldenVectors, scope: BlockScope
) -> None:
    scope.reserve(_ROW)
    every = _distance(jacobian, len(golden.status))
    inner = scope.inner()
    for field in jacobian.fields:
        _compare(interface, field, golden.slopes[field.matrix.name][::every], inner)
    row = c.Binary("/", c.Name("step"), c.Unsigned(every))
    scope.add(c.Declare(c.CType.UNSIGNED, _ROW, row, constant=True))
    # unsigned division cuts off, so that only multiples come back as themselves
    chosen = c.Binary("==", c.Binary("*", c.Name(_ROW), c.Unsigned(every)), c.Name("step"))
    scope.add(c.If(chosen, tuple(inner.statements)))


def _infinite(jacobian: JacobianInterface, slopes: Mapping[str, NDArray[Any]]) -> NDArray[Any]:
    """For every golden step (steps,), the status bit that linearize sets if an entry is infinite or
    NaN, else 0. `slopes` are the matrices (steps, rows, columns) by name.
    """
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
"""Status bits that depend on the results of a step."""
_ROW = "row"
_MOST_NUMBERS = 16384
"""Maximum number of golden entries in one table, limited by the memory of small
microcontrollers."""


def _distance(jacobian: JacobianInterface, steps: int) -> int:
    """The entries of every n-th golden step are compared by value; returns n. It is 1 unless the
    tables of all steps would have more than `_MOST_NUMBERS` elements.
    """
    computed = sum(field.matrix.known.count(None) for field in jacobian.fields)
    return max(1, -(-computed * steps // _MOST_NUMBERS))


def _compare(
    interface: Interface, field: MatrixField, golden: NDArray[Any], scope: BlockScope
) -> None:
    """Writes a loop that compares all entries of a matrix: computed ones with a row of a table of
    the values `golden` (steps, rows, columns), the others with their constants.
    """
    matrix, name = field.matrix, field.identifier
    steps = len(golden)
    computed = [i for i, known in enumerate(matrix.known) if known is None]
    numbers = golden.reshape(steps, matrix.size)[:, computed]
    table, places, constants = (f"{kind}_{name}" for kind in ("golden", "computed", "known"))
    count = len(computed)
    if computed:
        scope.add(c.ConstantTable(table, tuple(numbers.ravel().tolist()), hexadecimal=True))
    zero: c.Expression = c.Real(0.0)
    some = any(matrix.known)
    if some:
        known = tuple(0.0 if number is None else number for number in matrix.known)
        scope.add(c.ConstantTable(constants, known, hexadecimal=True))
    every = count == matrix.size
    reached = f"reached_{name}"
    if computed and not every:
        scope.add(c.ConstantTable(places, tuple(map(float, computed)), c.CType.UNSIGNED))
        scope.add(c.Declare(c.CType.UNSIGNED, reached, c.Unsigned(0)))
    with scope.loop(matrix.size) as (index, inner):
        at = index.expression()
        row = variable(_ROW).times(count)
        expected: c.Expression = c.Element(c.Name(constants), at) if some else zero
        if every:
            expected = c.Element(c.Name(table), row.plus(index).expression())
        elif computed:
            inner.add(c.Declare(c.CType.REAL, "expected", expected))
            expected = c.Name("expected")
            # computed entries ascend: one counter walks through them beside the loop over all
            left = c.Binary("<", c.Name(reached), c.Unsigned(count))
            here = c.Binary("==", c.Element(c.Name(places), c.Name(reached)), at)
            number = c.Element(c.Name(table), row.plus(variable(reached)).expression())
            onward = c.Assign(c.Name(reached), c.Binary("+", c.Name(reached), c.Unsigned(1)))
            inner.add(c.If(c.Binary("&&", left, here), (c.Assign(expected, number), onward)))
        given = field.place.element([index])
        allowed = c.Real(tolerance(interface, golden))
        differs = c.Call(f"{interface.prefix}_differs", (given, expected, allowed))
        inner.add(c.If(differs, (c.Assign(c.Name("differ"), c.Truth(True)),)))


Array = NDArray[Any]
_VECTOR, _DIFFER, _GOLDEN = "v", "differ", "golden"


def helper_functions(
    interface: Interface,
    jacobian: JacobianInterface,
    golden: GoldenVectors,
    weights: Mapping[str, Array],
) -> tuple[c.Function, ...]:
    """C functions such as `<prefix>_x_differs(v)`, one for each vector of the Jacobian: true if v
    differs from its golden values. These are those of the first golden step, for x the states after
    it, and for p the weights.
    """
    first = {
        "x": golden.states,
        "u": golden.inputs,
        "y": golden.outputs,
        # as the vectors of steps are: one row a step, and parameters have the same in each
        "p": {name: np.asarray(values)[np.newaxis] for name, values in weights.items()},
    }
    vectors = (
        jacobian.jacobian.states,
        jacobian.jacobian.inputs,
        jacobian.jacobian.outputs,
        jacobian.jacobian.parameters,
    )
    there = {vector.letter for vector in jacobian.vectors}
    return tuple(
        _comparison(interface, vector.letter, _numbers(vector, first[vector.letter], interface))
        for vector in vectors
        if vector.letter in there
    )


def resumed_step(interface: Interface, golden: GoldenVectors) -> int | None:
    """The index of the first golden step at which a run can be resumed from its state alone; None
    if there is none. It is after step 0, and all inputs with policy `hold` are valid in it, so that
    no earlier input has an influence.
    """
    # not the first: golden vectors have states after steps, and it goes on from none of these
    for step in range(1, len(golden.status)):
        held = [input for input in interface.inputs if input.held is not None]
        if all(_valid(input.field.name, golden, step) for input in held):
            return step
    return None


def _valid(name: str, golden: GoldenVectors, step: int) -> bool:
    return bool(np.array_equal(golden.inputs[name][step], golden.seen[name][step]))


def _numbers(vector: Vector, values: Mapping[str, Array], interface: Interface) -> Array:
    """The elements of a vector of the Jacobian, taken from the first row of `values` (rows, *shape)
    by name, in the type of the code.
    """
    parts = [values[member.name][0].ravel() for member in vector.members]
    return np.concatenate(parts).astype(interface.options.dtype)


def _comparison(interface: Interface, letter: str, numbers: Array) -> c.Function:
    prefix = interface.prefix
    scope = BlockScope(LocalNames(prefix))
    for name in (_VECTOR, _DIFFER, _GOLDEN):
        scope.reserve(name)
    scope.add(c.ConstantTable(_GOLDEN, tuple(numbers.tolist()), hexadecimal=True))
    scope.add(c.Declare(c.CType.BOOL, _DIFFER, c.Truth(False)))
    allowed = c.Real(tolerance(interface, numbers))
    with scope.loop(len(numbers)) as (index, inner):
        at = index.expression()
        pair = (c.Element(c.Name(_VECTOR), at), c.Element(c.Name(_GOLDEN), at), allowed)
        inner.add(c.If(c.Call(f"{prefix}_differs", pair), DIFFER))
    scope.add(c.Return(c.Name(_DIFFER)))
    argument = c.Argument(f"const {prefix}_real *", _VECTOR)
    return scope.function(f"{prefix}_{letter}_differs", "bool", (argument,))
