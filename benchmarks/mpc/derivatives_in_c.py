"""Writes value, Jacobian and Hessian of one step as a C function of plain arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from backends.c_kernels.sources import c_sources
from backends.c_language.functions import FunctionNames, FunctionTable
from backends.c_language.places import ArrayView, Index, c_strides
from backends.c_language.printer import Printer
from backends.c_language.scope import BlockScope, LocalNames, SpecName
from backends.c_language.tree import Argument, Function, Name, Real
from backends.c_lowering.graph import GraphLowering
from backends.c_lowering.spec_notes import SpecNotes
from backends.c_lowering.values import LocalValues
from compiler.hessian.step_derivatives import StepDerivatives, multiplier
from compiler.ir.ops import AnyRead, ReadParameter, ReadSignal, ReadState, Window
from compiler.ir.types import Type

Weights = Mapping[str, NDArray[np.float64]]


@dataclass
class _Leaves:
    """Translates leaves of the graph: z and λ are read from arrays, parameters are numbers in the
    text.
    """

    derivatives: StepDerivatives
    weights: Weights
    locals: LocalValues
    scope: BlockScope

    def read(self, op: AnyRead, type: Type) -> ArrayView:
        if isinstance(op, ReadParameter):
            values = tuple(self.weights[op.name].ravel().tolist())
            return self.locals.known(values, type, SpecName(op.name), self.scope)
        assert isinstance(op, ReadState | ReadSignal)
        name = op.name if isinstance(op, ReadState) else op.signal
        for array, vector, named in (
            ("z", self.derivatives.variables, str),
            ("lambda", self.derivatives.results, multiplier),
        ):
            for member in vector.members:
                if named(member.name) == name:
                    at = Index(member.first)
                    return ArrayView(Name(array), type.shape, c_strides(type.shape), at)
        raise AssertionError(f"{name} is no variable")

    def push(self, op: Window, newest: ArrayView, scope: BlockScope) -> ArrayView | None:
        return None


def derivatives_source(
    found: StepDerivatives, weights: Weights, name: str, math: Literal["own", "libm"] = "own"
) -> str:
    """`void NAME(z, lambda, r, J, H)` and the kernels that it calls, in double."""
    table = FunctionTable(FunctionNames(name, "float64", math, False))
    scope = BlockScope(LocalNames(name))
    for taken in ("z", "lambda", "r", "J", "H"):
        scope.reserve(taken)
    locals = LocalValues(table, SpecNotes(found.graph), 4, block=6)
    leaves = _Leaves(found, weights, locals, scope)
    lowered = GraphLowering(found.graph, found.roots, leaves, scope, locals)
    for member in found.results.members:
        node = found.values[member.name]
        shape = found.graph[node].type.shape
        lowered.store(node, ArrayView(Name("r"), shape, c_strides(shape), Index(member.first)))
    for matrix in found.matrices:
        for place, known in enumerate(matrix.known):
            if known is not None:
                entry = ArrayView(Name(matrix.name), (matrix.size,), (1,))
                scope.assign(entry.element([Index(place)]), Real(known))
        for block in matrix.blocks:
            shape = found.graph[block.node].type.shape
            view = ArrayView(Name(matrix.name), shape, block.strides, Index(block.offset))
            lowered.store(block.node, view)
    statements = scope.statements
    real = f"{name}_real"
    arguments = (
        Argument(f"const {real} *", "z"),
        Argument(f"const {real} *", "lambda"),
        Argument(f"{real} *", "r"),
        Argument(f"{real} *", "J"),
        Argument(f"{real} *", "H"),
    )
    body = (*locals.constants(statements), *statements)
    function = Printer(name, "float64").function(
        Function(name=name, result="void", arguments=arguments, body=body, doc="")
    )
    includes = "".join(f"#include <{header}.h>\n" for header in ("math", "stdbool", "stdint"))
    parts = [f"{includes}typedef double {real};\n", function]
    if table.kernels:
        kernels = c_sources(table.kernels, "double", name)
        own = kernels.source.replace(f'#include "{kernels.header_name}"', "")
        parts[1:1] = [kernels.header, own]
    return "\n".join(parts)
