"""Writes the formulas of an `mpc` section as outputs, in the form that solvers step."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace

from compiler.ir import ops
from compiler.ir.builder import GraphBuilder
from compiler.ir.nodes import extents, needed, needed_over_time
from compiler.ir.ops import Apply, Compare, ReadSignal
from compiler.ir.program import Graph, NodeId, Output, Program
from compiler.ir.types import Type
from compiler.linking.link import Connected, Linked
from compiler.lowering.context import Scope
from compiler.passes.close_loop import LoopError, close_loop
from compiler.passes.simplify import drop_unused
from compiler.passes.to_step_form import to_step_form
from msnn.features.control.errors import control as errors
from msnn.features.control.keys import ControlReference, OptimalControl
from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.errors import names
from spec_schema.errors import time as times
from spec_schema.errors.states import not_closable
from spec_schema.expressions.tree import Expression, Name
from spec_schema.fields.leaf import KeyAndValueSpan
from spec_schema.sections.signals import Input
from spec_schema.sections.signals import Output as SpecOutput
from spec_schema.sections.spec import Spec
from spec_schema.units.quantity import Quantity


def signals_behind(program: Program, nodes: Iterable[NodeId]) -> set[str]:
    """The names of the signals on which the values of these nodes depend, in the same step or,
    through states, in any step before.
    """
    following = {state.name: state.next for state in program.states}
    live, _ = needed_over_time(program.step, following, nodes)
    return _read(program, live)


def signals_in_step(program: Program, node: NodeId) -> set[str]:
    """The names of the signals whose samples at t affect the value of a node, for a program in step
    form.

    If a window contains the newest sample, only that sample counts: older ones belong to earlier
    steps.
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
    """Yields the operands of comparisons and signs among the nodes that `live` marks; there, a
    derivative of 0 does not mean independence.
    """
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


_FORMULA = "mpc: "
"""Prefix of the names of such outputs; no name that a spec declares has a blank."""
STAGE = f"{_FORMULA}cost.stage"
TERMINAL = f"{_FORMULA}cost.terminal"


def bounded(name: str) -> str:
    """The name of the output that computes a bounded state, output or equation."""
    return f"{_FORMULA}bounds.{name}"


def limit(name: str, key: str) -> str:
    """The name of the output that computes a limit of `name`; `key` is `min` or `max`."""
    return f"{_FORMULA}bounds.{name}.{key}"


@dataclass(frozen=True, kw_only=True)
class ControlSpec:
    """A linked spec with references as further inputs and formulas of `mpc` as further outputs."""

    linked: Linked
    section: OptimalControl
    formulas: tuple[str, ...]
    """The names of those outputs."""
    controls: tuple[str, ...]
    closed: Mapping[str, str]
    """The inputs that are fed back along the horizon, by the outputs that predict them."""


def control_spec(linked: Linked, section: OptimalControl, findings: Findings) -> ControlSpec:
    """The model that computes all formulas of the `mpc` section of a linked spec.

    Reports parts of the section that do not fit the declarations of the spec.
    """
    spec = linked.spec
    if spec.sample_time is None:
        findings.report(times.needs_sample_time("`mpc`", section.place.key))
    # only of an input: what predicts a target or a state feeds nothing back
    closed = {
        output.predicts.signal.value: name
        for name, output in spec.outputs.items()
        if output.predicts is not None and output.predicts.signal.value in spec.inputs
    }
    _check_controls(spec, section, closed, findings)
    _check_references(spec, section, findings)
    _check_bounds(spec, section, findings)
    _check_previews(spec, section, closed, findings)
    formulas = dict(_formulas(section))
    outputs = {n: _output(expr) for n, expr in formulas.items()}
    inputs = {name: _input(entry) for name, entry in section.references.items()}
    # pydantic does not validate a copy: what is added was read from the file already
    whole = spec.model_copy(
        update={
            "inputs": {**spec.inputs, **inputs},
            "outputs": {**spec.outputs, **outputs},
            "mpc": None,
        }
    )
    controls = tuple(control.value for control in section.controls)
    return ControlSpec(
        linked=replace(linked, spec=whole),
        section=section,
        formulas=tuple(formulas),
        controls=controls,
        closed=closed,
    )


def _formulas(section: OptimalControl) -> list[tuple[str, Expression]]:
    found = [(STAGE, section.cost.stage)]
    if section.cost.terminal is not None:
        found.append((TERMINAL, section.cost.terminal))
    controls = {control.value for control in section.controls}
    for name, bound in section.bounds.items():
        if name not in controls:
            found.append((bounded(name), Name(name, bound.place.key)))
        # a number becomes an output later, once the compiler knows the unit of what it limits
        for key, value in (("min", bound.min), ("max", bound.max)):
            if value is not None and not isinstance(value, Quantity):
                found.append((limit(name, key), value))
    return found


def _output(expression: Expression) -> SpecOutput:
    place = KeyAndValueSpan(expression.span, expression.span)
    return SpecOutput.model_construct(place=place, expr=expression)


def _input(entry: ControlReference) -> Input:
    return Input.model_construct(place=entry.place, unit=entry.unit, dims=entry.dims, doc=entry.doc)


def _check_controls(
    spec: Spec, section: OptimalControl, closed: Mapping[str, str], findings: Findings
) -> None:
    for control in section.controls:
        name = control.value
        if name not in spec.inputs:
            found = _kind(spec, name)
            findings.report(errors.not_a_control(name, found, control.span, spec.inputs))
        elif name in closed:
            predicts = spec.outputs[closed[name]].predicts
            assert predicts is not None
            fault = errors.closed_control(name, closed[name], control.span, predicts.span)
            findings.report(fault)


def _check_references(spec: Spec, section: OptimalControl, findings: Findings) -> None:
    # findings of its own: the model has been compiled, and what is wrong with its names was told
    scope = Scope(spec, Findings())
    for name, entry in section.references.items():
        # references become inputs of the asked model, among whose names there is only one of each
        if name in scope:
            first = scope[name]
            place, kind = first.entry.place.key, first.kind.value
            findings.report(names.declared_twice(name, entry.place.key, place, kind))


def _check_bounds(spec: Spec, section: OptimalControl, findings: Findings) -> None:
    controls = {control.value for control in section.controls}
    for name, bound in section.bounds.items():
        kind = _kind(spec, name)
        place = bound.place.key
        if name in controls:
            # a control goes to an actuator: its limits hold whatever the solve does, so neither
            # word fits
            if bound.soft is not None:
                place = bound.soft.place.key
                findings.report(errors.bound_option(name, "soft", "a control", place))
            elif bound.hard:
                findings.report(errors.bound_option(name, "hard", "a control", place))
        elif kind is None:
            known = [*controls, *spec.states, *spec.outputs, *spec.equations]
            reason = "which nothing declares"
            findings.report(errors.not_bounded(name, reason, place, known))
        # an input that is fed back along the horizon moves like a state; `path_limits` refuses
        # others
        elif not any(name in part for part in (*_bounded_sections(spec), spec.inputs)):
            findings.report(errors.not_bounded(name, f"which is {kind}", place, ()))
        elif bound.rate is not None:
            findings.report(errors.bound_option(name, "rate", kind, bound.rate.span))


def _check_previews(
    spec: Spec, section: OptimalControl, closed: Mapping[str, str], findings: Findings
) -> None:
    controls = {control.value for control in section.controls}
    for entry in section.preview:
        name = entry.value
        if name in controls:
            findings.report(errors.needless_preview(name, "a control", entry.span))
        elif name in closed:
            findings.report(errors.needless_preview(name, "fed back", entry.span))
        elif name not in spec.inputs:
            known = _kind(spec, name) or "no input of the model"
            findings.report(errors.needless_preview(name, known, entry.span))


def _bounded_sections(spec: Spec) -> tuple[Mapping[str, object], ...]:
    return spec.states, spec.outputs, spec.equations


def _kind(spec: Spec, name: str) -> str | None:
    """The kind of a declared name as messages call it, such as `input`; None if the name is not
    declared.
    """
    declared = Scope(spec, Findings()).get(name)
    if declared is None:
        return None
    return "connected" if isinstance(declared.entry, Connected) else declared.kind.value


def control_program(
    asked: ControlSpec, program: Program, with_previous: Iterable[str], findings: Findings
) -> Program | None:
    """The compiled program in step form for a solver: loops are closed, its outputs are the
    formulas of the section, and its ports have samples from t on.

    Its states include u[t-1] of the controls `with_previous`. None after reporting a mistake.
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
    """The graph without the labels of formulas, which would appear in generated code."""
    nodes = (replace(n, label=None) if n.label in formulas else n for n in graph.nodes)
    return Graph(tuple(nodes))


def _with_samples(program: Program, reads: Iterable[tuple[str, int]]) -> Program:
    """The program with an output for each sample (signal, offset from t), so that its step form has
    them as ports or states.
    """
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
