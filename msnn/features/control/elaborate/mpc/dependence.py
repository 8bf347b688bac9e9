"""Finds the signals that a value depends on, within its step and along a horizon."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

from compiler.ir.nodes import needed, needed_over_time
from compiler.ir.ops import Apply, Compare, ReadSignal
from compiler.ir.program import NodeId, Output, Program


def signals_behind(program: Program, nodes: Iterable[NodeId]) -> set[str]:
    """The signals that values depend on in their step or, through states, in any before."""
    following = {state.name: state.next for state in program.states}
    live, _ = needed_over_time(program.step, following, nodes)
    return _read(program, live)


def signals_in_step(program: Program, node: NodeId) -> set[str]:
    """The signals whose current samples a value depends on, in step form.

    A window that holds the newest sample is looked into: its older samples are not of this step.
    """
    live = needed(program.step, [node])
    if not _read(program, live):
        return set()
    # specs without such formulas are checked without derivatives
    from compiler.jacobian.jacobian import jacobian

    # ∂/∂u with the states held: what moves those was decided in earlier steps. A jump has no slope
    # and depends all the same: what it is of counts in its place
    values = [node, *_jumping(program, live)]
    outputs = tuple(Output(f"value {i}", value) for i, value in enumerate(values))
    found = jacobian(replace(program, states=(), outputs=outputs))
    # of A, B, C and D the last, ∂y/∂u
    slopes = next(matrix for matrix in found.matrices if matrix.name == "D")
    rows, columns = slopes.shape
    return {
        member.name
        for member in slopes.columns.members
        for row in range(rows)
        # None, a slope that is known only when the model runs, counts as dependence
        if any(
            slopes.known[row * columns + member.first + number] != 0.0
            for number in range(member.size)
        )
    }


def _jumping(program: Program, live: list[bool]) -> Iterator[NodeId]:
    """The operands of comparisons and signs among these nodes."""
    for index, node in program.step:
        match node.op:
            case Compare() | Apply(function="sign") if live[index]:
                yield from node.args
            case _:
                pass


def _read(program: Program, live: list[bool]) -> set[str]:
    graph = program.step
    return {
        node.op.signal for index, node in graph if live[index] and isinstance(node.op, ReadSignal)
    }
