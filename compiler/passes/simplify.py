"""Simplifies programs: drops unused nodes and outputs, folds constants, shares equal nodes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np

from compiler.interpreter.operations import NOWHERE, Array, evaluator
from compiler.ir import ops
from compiler.ir.builder import GraphBuilder, copy_node, with_start, with_step
from compiler.ir.nodes import needed, needed_over_time, parameters_read
from compiler.ir.ops import Named, ReadSamples, ReadSignal, ReadState, Reshape
from compiler.ir.program import Fit, Graph, Node, NodeId, Output, Program, Role, Signal, State


def drop_unused(program: Program) -> Program:
    """Removes nodes, states, parameters and signals that no output and no loss depends on.

    A program with losses keeps targets and the signals that outputs predict, as validation compares
    with them. Without its predicted signal an output is no longer marked as predicting. A fit keeps
    its signals; it is removed with its layer or with the losses. The range of an equation is
    removed with the users of its value.

    Before and after: any form. Example of a removed state:

        state x: scalar m, next %1, start %0      # read by no node that an output needs
    """
    live, names = _live(program)
    states = tuple(state for state in program.states if state.name in names)
    # after the states: starts of removed states are not needed
    started = needed(program.start, [state.start for state in states])
    step, now = _kept(program.step, live)
    start, first = _kept(program.start, started)
    read = _signals_read(step) | _signals_read(start)
    if program.losses:
        read |= {out.predicts.signal for out in program.outputs if out.predicts}
        # a program without losses is deployed and needs no targets
        read |= {signal.name for signal in program.signals if signal.role is Role.TARGET}
    used = parameters_read(step) | parameters_read(start)
    # a fit needs all arrays of its layer
    fits = [fit for fit in program.fits if program.losses and _sets_only(fit, used)]
    for fit in fits:
        read |= {*_signals_read(fit.argument), fit.target.signal}
        used |= parameters_read(fit.argument)
    if program.losses:
        statistics = [p.statistic for p in program.parameters if p.name in used]
        read |= {statistic.signal for statistic in statistics if statistic is not None}
    return replace(
        program,
        signals=tuple(signal for signal in program.signals if signal.name in read),
        parameters=tuple(parameter for parameter in program.parameters if parameter.name in used),
        states=tuple(
            replace(state, next=now[state.next], start=first[state.start]) for state in states
        ),
        step=step,
        start=start,
        outputs=tuple(_output(output, now, read) for output in program.outputs),
        losses=tuple(loss.moved(now) for loss in program.losses),
        expected=tuple(
            replace(entry, node=now[entry.node]) for entry in program.expected if entry.node in now
        ),
        fits=tuple(fits),
    )


def _sets_only(fit: Fit, used: frozenset[str]) -> bool:
    """True if all parameter arrays of the fit's layer are still in the program; `used` are the
    names of its parameters.
    """
    return all(f"{fit.layer}.{array}" in used for array in fit.array_names)


def _live(program: Program) -> tuple[list[bool], set[str]]:
    """One flag per node of the step, True if an output or a loss depends on it, and the names of
    the states on which they depend.
    """
    wanted = [output.node for output in program.outputs]
    for loss in program.losses:
        wanted += loss.nodes
    return needed_over_time(program.step, {s.name: s.next for s in program.states}, wanted)


def _kept(graph: Graph, live: list[bool]) -> tuple[Graph, dict[NodeId, NodeId]]:
    kept: list[Node] = []
    now: dict[NodeId, NodeId] = {}
    for index, node in graph:
        if live[index]:
            now[index] = len(kept)
            args = tuple(now[arg] for arg in node.args)
            kept.append(
                Node(op=node.op, args=args, type=node.type, span=node.span, label=node.label)
            )
    return Graph(tuple(kept)), now


def _signals_read(graph: Graph) -> set[str]:
    return {node.op.signal for _, node in graph if isinstance(node.op, ReadSamples)}


def _output(output: Output, now: dict[NodeId, NodeId], read: set[str]) -> Output:
    predicts = output.predicts if output.predicts and output.predicts.signal in read else None
    return replace(output, node=now[output.node], predicts=predicts)


LARGEST_FOLDED = 4096
"""Maximum number of elements of a folded value; larger ones would make the program larger."""


def fold_constants(program: Program) -> Program:
    """Replaces nodes that depend on constants only by their float64 value in the interpreter.

    A `Select` with a constant condition becomes the selected operand. Not folded are values that
    are not finite or too large, bools, and broadcast constants.

    Before and after: any form. Nodes that lose their users are left for `drop_unused`. Example,
    before and after:

        %0: scalar 1 = constant 2.0
        %1: scalar 1 = sqrt(%0)

        %1: scalar 1 = constant 1.4142135623730951
    """
    program = with_step(program, *folded(program.step))
    return with_start(program, *folded(program.start))


def folded(
    graph: Graph, *, exact: int = 0, largest: int = LARGEST_FOLDED
) -> tuple[Graph, dict[NodeId, NodeId]]:
    """The graph after constant folding as in `fold_constants`, and the new node ids by the old
    ones.

    The first `exact` nodes do not change; `largest` limits the number of elements of a folded
    value.
    """
    builder = GraphBuilder()
    copies: dict[NodeId, NodeId] = {}
    known: list[Any] = []
    for index, node in graph:
        value = _value(graph, node, known, largest)
        # stored even if the node stays, so that its users can be folded
        known.append(value)
        chosen = _chosen(node, known) if index >= exact else None
        if chosen is not None:
            copies[index] = copies[chosen]
        elif index >= exact and value is not None and _replaces(graph, node, value):
            numbers = ops.Constant(tuple(float(number) for number in value.ravel()))
            folded = Node(op=numbers, args=(), type=node.type, span=node.span, label=node.label)
            copies[index] = copy_node(builder, folded, ())
        else:
            copies[index] = copy_node(builder, node, tuple(copies[arg] for arg in node.args))
    return builder.graph(), copies


def _value(graph: Graph, node: Node, known: list[Any], largest: int) -> Array | None:
    """The node's value, an array (1, *shape), if it depends on constants only and has at most
    `largest` elements; else None. `known` has the values of earlier nodes, by id.
    """
    if isinstance(node.op, ops.Read | ops.Window) or node.type.size > largest:
        return None
    if any(known[arg] is None for arg in node.args):
        return None
    types = tuple(graph[arg].type for arg in node.args)
    evaluate = evaluator(node, types, {}, np.dtype(np.float64))
    with np.errstate(all="ignore"):
        return evaluate(known, NOWHERE)


def _chosen(node: Node, known: list[Any]) -> NodeId | None:
    """The operand that a `Select` takes if its condition is a constant and the same for all
    elements; None for any other node. `known` has the constant values of nodes, by id.
    """
    if not isinstance(node.op, ops.Select):
        return None
    condition, then, otherwise = node.args
    holds = known[condition]
    # conditions that differ between elements need the selection
    if holds is None or holds.any() != holds.all():
        return None
    return then if holds.all() else otherwise


def _replaces(graph: Graph, node: Node, value: Array) -> bool:
    if isinstance(node.op, ops.Constant) or node.type.kind != "real":
        return False
    # a broadcast constant is stored once
    if isinstance(node.op, ops.Broadcast) and graph[node.args[0]].type.size < node.type.size:
        return False
    # a value that is not finite stays an operation, for which `never_finite` warns
    return bool(np.isfinite(value).all())


def share_common(program: Program) -> Program:
    """Merges nodes of equal operation, operands and type; the first one's place and label stay.

    Consecutive reshapes become one, or none if the type does not change. A `Named` node becomes its
    operand. Before: any form. After: any form without `Named`. Example, before and after:

        %1: scalar m = %0 * %0
        %2: scalar m = %0 * %0
        %3: scalar m = %1 + %2

        %1: scalar m = %0 * %0
        %2: scalar m = %1 + %1
    """
    program = with_step(program, *_shared(program.step))
    return with_start(program, *_shared(program.start))


def _shared(graph: Graph) -> tuple[Graph, dict[NodeId, NodeId]]:
    builder = GraphBuilder()
    copies: dict[NodeId, NodeId] = {}
    for index, node in graph:
        args = tuple(copies[arg] for arg in node.args)
        if isinstance(node.op, Reshape):
            args = (_before_reshapes(builder, args[0]),)
        unchanged = isinstance(node.op, Reshape) and builder.type(args[0]) == node.type
        if unchanged or isinstance(node.op, Named):
            copies[index] = args[0]
            # the name may have a declared unit, which its operand lacks
            builder.set_unit(args[0], node.type.unit)
            if node.label is not None:
                builder.name(args[0], node.label)
        else:
            copies[index] = copy_node(builder, node, args)
    return builder.graph(), copies


def _before_reshapes(builder: GraphBuilder, value: NodeId) -> NodeId:
    while isinstance(builder.node(value).op, Reshape):
        value = builder.node(value).args[0]
    return value


def prune_outputs(program: Program, names: Iterable[str]) -> Program:
    """The program with only the named outputs and the states that they depend on, without losses.

    Exporting the controller of a closed loop removes the plant and all that only the plant or a
    loss reads. A discrete state may depend on a sub-model that no output needs in the same step. It
    is then measured: it becomes an input of the same name (R13).

    Before and after: any form. Raises KeyError for a name that no output has. Example of a removed
    output:

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
