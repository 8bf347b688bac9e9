"""Reduces a program to the deployed part of a model: some outputs and their dependencies."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from compiler.ir.ops import ReadSignal, ReadState
from compiler.ir.program import Graph, Node, Program, Role, Signal, State
from compiler.passes.simplify.drop_unused import drop_unused


def prune_outputs(program: Program, names: Iterable[str]) -> Program:
    """The program with only the named outputs and the states they depend on, without losses.

    Exporting the controller of a closed loop removes the plant and all that only the plant or a
    loss reads. A discrete state may depend on a sub-model that no output needs in the same step. It
    is then measured: it becomes an input of the same name (R13).

    Before and after: any form. Raises KeyError for a name that no output has.

        output command = %7
        output plant = %13          # pruned to command: %8 … %13 go too
    """
    wanted = dict.fromkeys(names)
    known = {output.name for output in program.outputs}
    for name in wanted:
        if name not in known:
            raise KeyError(name)
    outputs = tuple(output for output in program.outputs if output.name in wanted)
    # uses the dependencies of the spec, since passes may have merged nodes
    kept = {submodel for output in outputs for submodel in output.needs}
    # a state whose `next` needs a removed sub-model cannot be stepped
    measured = {state.name: state for state in program.states if not kept.issuperset(state.needs)}
    pruned = drop_unused(replace(program, outputs=outputs, losses=()))
    ports = [measured[state.name] for state in pruned.states if state.name in measured]
    # again: dependencies of the next values of measured states are now unused
    return drop_unused(_with_ports(pruned, ports)) if ports else pruned


def _with_ports(program: Program, states: list[State]) -> Program:
    names = {state.name for state in states}
    logged = [signal for signal in program.signals if signal.name not in names]
    # a state of this step is the sample t of a port (R13)
    nodes = tuple(_measured(node, names) for node in program.step.nodes)
    return replace(
        program,
        signals=(*logged, *(_port(state) for state in states)),
        states=tuple(state for state in program.states if state.name not in names),
        step=Graph(nodes),
    )


def _measured(node: Node, names: set[str]) -> Node:
    if isinstance(node.op, ReadState) and node.op.name in names:
        return replace(node, op=ReadSignal(node.op.name, 0, 0))
    return node


def _port(state: State) -> Signal:
    return Signal(
        name=state.name,
        role=Role.INPUT,
        axes=state.axes,
        unit=state.unit,
        range=state.range,
        doc=state.doc,
        span=state.span,
    )
