"""Compares, in C, copies of structs in vectors with their golden values."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.c.interface.interface import Interface
from backends.c.interface.jacobian_interface import JacobianInterface
from backends.c.selftest.text.golden_tables import DIFFER
from backends.c.selftest.text.golden_text import tolerance
from backends.c.selftest.vectors.golden_vectors import GoldenVectors
from backends.c_language import tree as c
from backends.c_language.scope import BlockScope, LocalNames
from compiler.jacobian.matrices import Vector

Array = NDArray[Any]
_VECTOR, _DIFFER, _GOLDEN = "v", "differ", "golden"


def helper_functions(
    interface: Interface,
    jacobian: JacobianInterface,
    golden: GoldenVectors,
    weights: Mapping[str, Array],
) -> tuple[c.Function, ...]:
    """C functions such as `<prefix>_x_differs(v)` that compare a vector with its golden values.

    The golden values are those of the first golden step and, for parameters, the trained ones.
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
    """The first golden step after step 0 that depends on earlier steps only through the state.

    All inputs with the policy `hold` are valid in it. None if there is no such step.
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
    """The values of the first row, in the order of the vector."""
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
