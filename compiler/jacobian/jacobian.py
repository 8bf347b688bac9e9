"""Jacobians of one step: derivatives of next states and outputs by states, inputs, parameters.

For x' = f(x, u, p), y = h(x, u, p) the matrices are A = ∂x'/∂x, B = ∂x'/∂u, C = ∂y/∂x, D = ∂y/∂u,
and on request ∂x'/∂p and ∂y/∂p. The vector x is the whole memory of the step: declared states and
samples in buffers, so that A is the matrix of the whole discrete system.

Every element of the next states and outputs is a row, computed separately. Structurally zero or
constant entries are stored as constants. Reverse mode computes the others, one pass per row, with
its conventions at kinks (`reverse_mode`).
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import assert_never

from compiler.ir.builder import GraphBuilder
from compiler.ir.liveness import needed
from compiler.ir.ops import ReadParameter, ReadSignal, ReadState
from compiler.ir.program import Declared, NodeId, Program
from compiler.jacobian.entries import matrix_of
from compiler.jacobian.matrices import Jacobian, Matrix, Vector, vector_of
from compiler.jacobian.row_gradients import slopes_of_elements
from compiler.jacobian.scalarize import Leaf, every_element, single_elements
from compiler.passes.derivatives.guard_untaken import guard_untaken


def jacobian(
    program: Program,
    *,
    parameters: bool = False,
    declared_only: bool = False,
    feedthrough_only: bool = False,
) -> Jacobian:
    """The Jacobian of a program in step form; with `parameters` also by the parameters of the step.

    With `declared_only` the vector x contains only declared states; other memory counts as
    constant. With `feedthrough_only` x is empty and D is the only matrix.
    """
    # losses and ranges of equations are not needed: the graph is shorter without them
    program = guard_untaken(replace(program, losses=(), expected=()))
    step = program.step
    kept = () if feedthrough_only else program.states
    listed = [s for s in kept if not declared_only or isinstance(s.origin, Declared)]
    results = {"x": [(s.name, s.next, s.axes, s.unit) for s in listed]}
    types = [(output, step[output.node].type) for output in program.outputs]
    results["y"] = [(output.name, output.node, type.axes, type.unit) for output, type in types]
    roots = [node for members in results.values() for _, node, _, _ in members]
    states, outputs = (
        vector_of(letter, [(name, axes, unit) for name, _, axes, unit in members])
        for letter, members in results.items()
    )
    inputs, tuned = _read(program, roots)

    elements = single_elements(
        step, [(root, at) for root in roots for at in every_element(step[root].type)]
    )
    names = {state.name for state in listed}
    wanted = [
        node for node, part in elements.parts.items() if _is_asked_for(part.leaf, parameters, names)
    ]
    graph, slopes = slopes_of_elements(elements, wanted)
    builder = GraphBuilder(graph)
    of_states, of_outputs = slopes[: states.size], slopes[states.size :]
    named = [
        ("A", states, states, of_states),
        ("B", states, inputs, of_states),
        ("C", outputs, states, of_outputs),
        ("D", outputs, inputs, of_outputs),
    ]
    if parameters:
        named += [("dx_dp", states, tuned, of_states), ("dy_dp", outputs, tuned, of_outputs)]
    matrices: list[Matrix] = [
        matrix_of(name, rows, columns, rows_slopes, elements.parts, builder)
        for name, rows, columns, rows_slopes in named
    ]
    return Jacobian(
        graph=builder.graph(),
        matrices=tuple(matrices),
        states=states,
        inputs=inputs,
        outputs=outputs,
        parameters=tuned,
    )


def _is_asked_for(leaf: Leaf, parameters: bool, states: Collection[str]) -> bool:
    match leaf:
        case ReadParameter():
            return parameters
        case ReadState(name):
            return name in states
        case ReadSignal():
            return True
        case _:
            assert_never(leaf)


def _read(program: Program, roots: Sequence[NodeId]) -> tuple[Vector, Vector]:
    """Inputs and parameters that the step reads, in the program's order."""
    marked = needed(program.step, roots)
    live = [node for index, node in program.step if marked[index]]
    ports = {n.op.signal: n.type for n in live if isinstance(n.op, ReadSignal)}
    names = {n.op.name for n in live if isinstance(n.op, ReadParameter)}
    inputs = [(s.name, ports[s.name].axes, s.unit) for s in program.signals if s.name in ports]
    tuned = [(p.name, p.axes, p.unit) for p in program.parameters if p.name in names]
    return vector_of("u", inputs), vector_of("p", tuned)
