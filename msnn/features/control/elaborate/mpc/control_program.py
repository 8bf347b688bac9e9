"""Brings the model of an `mpc` section's formulas into step form for solvers."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import replace

from compiler.ir import ops
from compiler.ir.builder import GraphBuilder
from compiler.ir.nodes import extents
from compiler.ir.program import Graph, Output, Program
from compiler.ir.types import Type
from compiler.passes.close_loop import LoopError, close_loop
from compiler.passes.simplify import drop_unused
from compiler.passes.to_step_form import to_step_form
from msnn.features.control.elaborate.mpc.control_spec import STAGE, TERMINAL, ControlSpec
from msnn.features.control.elaborate.mpc.dependence import signals_behind
from msnn.features.control.errors import control as errors
from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.errors.states import not_closable


def control_program(
    asked: ControlSpec, program: Program, with_previous: Iterable[str], findings: Findings
) -> Program | None:
    """The program in step form, loops closed, with formulas as outputs and ports from t on.

    Its states hold u[t-1] of the controls `with_previous`. None once a mistake is reported.
    """
    try:
        program = close_loop(program, asked.closed)
    except LoopError as error:
        place = error.span or asked.section.place.key
        findings.report(not_closable(error.signal, place, error.reason))
        return None
    # on the closed program: what a control moves through the feedback counts
    _check_cost(asked, program, findings)
    # not before the loop is closed: it runs through outputs that no formula names
    wanted = tuple(output for output in program.outputs if output.name in asked.formulas)
    program = drop_unused(replace(program, outputs=wanted, losses=(), expected=()))
    _check_times(asked, program, findings)
    _check_dropout(program, findings)
    if findings.failed:
        return None
    # a signal that formulas read at t−d alone would become a port with a lag (R13), and a solver
    # could not tell of which stage it is
    reads = {(name, 0) for name in extents(program.step, log=False)}
    # read a sample back, a control gets a register: the u_{k−1} of rates and blocks
    reads |= {(name, -1) for name in with_previous}
    whole = to_step_form(_with_samples(program, sorted(reads)))
    kept = tuple(output for output in whole.outputs if output.name in asked.formulas)
    return replace(whole, outputs=kept, step=_without_names(whole.step, asked.formulas))


def _without_names(graph: Graph, formulas: Collection[str]) -> Graph:
    """The graph without the names of formulas, which would appear in generated code."""
    nodes = (replace(n, label=None) if n.label in formulas else n for n in graph.nodes)
    return Graph(tuple(nodes))


def _with_samples(program: Program, reads: Iterable[tuple[str, int]]) -> Program:
    """The program with an output for each of these samples, so that its ports keep them."""
    builder = GraphBuilder(program.step)
    outputs = list(program.outputs)
    for name, at in reads:
        signal = program.signal(name)
        node = builder.signal(name, at, at, Type(signal.axes, signal.unit))
        outputs.append(Output(f"mpc: sample of {name} {at}", node))
    return replace(program, step=builder.graph(), outputs=tuple(outputs))


def _check_cost(asked: ControlSpec, program: Program, findings: Findings) -> None:
    cost = [output.node for output in program.outputs if output.name in (STAGE, TERMINAL)]
    moving = signals_behind(program, cost)
    for control in asked.section.controls:
        if control.value not in moving:
            place = asked.section.cost.place.key
            findings.report(errors.cost_without_control(control.value, place, control.span))


def _check_times(asked: ControlSpec, program: Program, findings: Findings) -> None:
    for _, node in program.step:
        if not isinstance(node.op, ops.ReadSignal):
            continue
        name, first, last = node.op.signal, node.op.first, node.op.last
        if name in asked.section.references and (first, last) != (0, 0):
            findings.report(errors.read_at_other_time(name, "reference", node.span))
        # past samples of a control are memory of the plant; later ones are not decided yet
        elif name in asked.controls and last > 0:
            findings.report(errors.read_at_other_time(name, "control", node.span))


def _check_dropout(program: Program, findings: Findings) -> None:
    for _, node in program.step:
        if isinstance(node.op, ops.Dropout):
            findings.report(errors.dropout_in_control(node.span))
