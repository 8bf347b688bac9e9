"""Removes nodes, states, parameters and signals that no output and no loss depends on."""

from __future__ import annotations

from dataclasses import replace

from compiler.ir.fit import Fit
from compiler.ir.liveness import needed, needed_over_time, parameters_read
from compiler.ir.ops import ReadSamples
from compiler.ir.program import Graph, Node, NodeId, Output, Program, Role


def drop_unused(program: Program) -> Program:
    """Removes nodes, states, parameters and signals that no output and no loss depends on.

    A program with losses keeps targets and the signals that outputs predict, as validation compares
    with them. Without its predicted signal an output is no longer marked as predicting. A fit keeps
    its signals; it is removed with its layer or with the losses. The range of an equation is
    removed with the users of its value.

    Before and after: any form.

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
    """True if the program still has all arrays of the layer."""
    return all(f"{fit.layer}.{array}" in used for array in fit.array_names)


def _live(program: Program) -> tuple[list[bool], set[str]]:
    """The needed nodes of the step, and the names of the needed states."""
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
