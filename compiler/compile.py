"""Spec → Program: lowers every entry, reports every mistake of the stage, verifies the result."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace

from compiler.builder import GraphBuilder
from compiler.liveness import needed, needed_over_time
from compiler.lowering.environment import Environment, Part
from compiler.lowering.failure import LoweringFailed
from compiler.lowering.histories import Known
from compiler.lowering.losses import default_loss, lower_loss
from compiler.lowering.model import Model
from compiler.lowering.scope import Kind
from compiler.never_finite import never_finite
from compiler.ops import ReadLog
from compiler.passes import run_passes
from compiler.program import (
    Declared,
    Dimension,
    Loss,
    Output,
    Prediction,
    Program,
    Role,
    Signal,
    State,
)
from compiler.types import describe_axes
from compiler.unit_rules import same_unit
from compiler.verifier import verify
from spec_schema.diagnostics import Diagnostic, Findings, SpecError
from spec_schema.errors import names, shapes, states, units
from spec_schema.errors import time as times
from spec_schema.signals import Output as OutputEntry
from spec_schema.signals import Signal as SignalEntry
from spec_schema.signals import State as StateEntry
from spec_schema.spec import Spec

_STEP = Environment(Part.STEP)
_START = Environment(Part.START)


@dataclass(frozen=True)
class Compiled:
    """A program and what is worth saying about the spec that it came from."""

    program: Program
    warnings: tuple[Diagnostic, ...]


def compile_spec(
    spec: Spec, *, strict_units: bool = False, spec_hash: str = "", draw: int = 0
) -> Compiled:
    """The program of a spec, in window form.

    Raises SpecError with every mistake found; with `strict_units` units that do not fit are errors.
    Another `draw` has other initial values where they are drawn.
    """
    lowered = _lowered(spec, draw)
    model, findings = lowered.model, lowered.model.findings
    diagnostics = tuple(
        replace(d, severity="error") if strict_units and d.code in ("W0504", "W0505") else d
        for d in findings.in_order
    )
    if any(d.severity == "error" for d in diagnostics):
        raise SpecError(diagnostics)
    program = Program(
        name=spec.name.value,
        sample_time=model.sampling.sample_time,
        signals=_signals(model),
        parameters=model.arrays.parameters,
        states=tuple(lowered.states),
        step=model.builder(_STEP).graph(),
        start=model.builder(_START).graph(),
        outputs=tuple(lowered.outputs),
        losses=tuple(lowered.losses),
        dimensions=tuple(Dimension(name, d.size, d.labels) for name, d in spec.dims.items()),
        doc=spec.doc or "",
        spec_hash=spec_hash,
    )
    verify(program)
    program = run_passes(program)
    return Compiled(program, (*diagnostics, *never_finite(program)))


@dataclass(frozen=True)
class _Lowered:
    """Everything of a spec as nodes of the model's graphs."""

    model: Model
    outputs: list[Output]
    states: list[State]
    losses: list[Loss]


_MOST_LOWERINGS = 100
"""Lengths and axes of buffers settle in two or three, later by at most one equation a lowering."""


def _lowered(spec: Spec, draw: int) -> _Lowered:
    """The spec lowered until the buffers that it needs are those that it has."""
    known = Known()
    for _ in range(_MOST_LOWERINGS):
        lowered = _lowered_once(spec, known, draw)
        found = lowered.model.found()
        if found == known:
            break
        known = found
    else:
        raise AssertionError("the buffers of a spec do not settle")
    lowered.states.extend(lowered.model.histories.states())
    lowered.states.extend(lowered.model.memories.states)
    _report_log_reads(lowered.model, lowered.outputs, lowered.states)
    if not lowered.model.findings.failed:  # what is left unused by a mistake is no news
        _report_unused(lowered.model)
    return lowered


def _lowered_once(spec: Spec, known: Known, draw: int) -> _Lowered:
    model = Model(spec, Findings(), known, draw)
    outputs = _outputs(model)
    states = _states(model)
    losses = _losses(model, outputs)
    _unused_equations(model)
    return _Lowered(model, outputs, states, losses)


def _outputs(model: Model) -> list[Output]:
    found: list[Output] = []
    for name, entry in model.spec.outputs.items():
        try:
            node = model.entries.value(name, entry, _STEP, entry.place.key)
            predicts = _prediction(model, name, entry)
        except LoweringFailed:
            continue
        if predicts is not None:
            node = _as_predicted(model, name, entry, node, predicts)
        found.append(Output(name, node, predicts, entry.doc or "", entry.place.key))
    return found


def _prediction(model: Model, name: str, entry: OutputEntry) -> Prediction | None:
    if entry.predicts is None:
        return None
    signal = entry.predicts.signal
    declared = model.scope.get(signal.value)
    if declared is None:
        known = [n for n, d in model.scope.items() if d.kind in _LOGGED]
        model.findings.report(names.unknown_name(signal.value, signal.span, known))
        raise LoweringFailed
    if declared.kind not in _LOGGED:
        model.findings.report(states.no_such_prediction(signal.value, signal.span))
        raise LoweringFailed
    model.used.add(signal.value)
    if declared.kind is Kind.STATE:
        model.measured.setdefault(signal.value, model.spec.states[signal.value])
    return Prediction(signal.value, model.sampling.samples(entry.predicts.ahead))


_LOGGED = (Kind.INPUT, Kind.TARGET, Kind.STATE)


def _as_predicted(
    model: Model, name: str, entry: OutputEntry, node: int, predicts: Prediction
) -> int:
    """The output's node with the axes and, where it had none, the unit of what it predicts."""
    builder = model.builder(_STEP)
    signal = model.scope[predicts.signal].entry
    assert isinstance(signal, SignalEntry | StateEntry)
    wanted = model.arrays.axes_of(signal)
    found = builder.type(node).axes
    if not set(found) <= set(wanted):
        model.findings.report(
            shapes.wrong_axes(
                f"`{name}`, which predicts `{predicts.signal}`,",
                describe_axes(wanted),
                describe_axes(found),
                entry.expr.span,
            )
        )
        return node
    unit = signal.unit.value if signal.unit else None
    own = builder.type(node).unit
    if own is None:
        builder.set_unit(node, unit)
    elif unit is not None and not same_unit(own, unit):
        model.findings.report(
            units.declared_unit_differs(name, own.text, unit.text, entry.expr.span)
        )
    return builder.broadcast(node, wanted)


def _states(model: Model) -> list[State]:
    found: list[State] = []
    start: GraphBuilder = model.builder(_START)
    for name, entry in model.spec.states.items():
        try:
            type = model.states.type(entry)
            following = model.states.next(name, entry)
        except LoweringFailed:
            following, type = None, None
        try:
            first = model.states.start(name, entry, start)
        except LoweringFailed:
            continue
        if following is None or type is None:
            continue
        found.append(
            State(
                name,
                type.axes,
                type.unit,
                Declared(),
                following,
                first,
                entry.range.value if entry.range else None,
                entry.doc or "",
                entry.place.key,
            )
        )
    return found


def _report_log_reads(model: Model, outputs: list[Output], table: list[State]) -> None:
    """A deployed step has no log: outputs and their states must do without (losses need not)."""
    graph = model.builder(_STEP).graph()
    following = {state.name: state.next for state in table}
    _, deployed = needed_over_time(graph, following, [output.node for output in outputs])
    results = [(output.name, output.node, output.span) for output in outputs]
    results += [(s.name, s.next, s.span) for s in table if s.name in deployed]
    reported: set[int] = set()
    for name, node, span in results:
        for index, is_needed in enumerate(needed(graph, (node,))):
            op = graph[index].op
            if is_needed and isinstance(op, ReadLog) and index not in reported:
                place = graph[index].span or span
                assert place is not None
                reported.add(index)
                model.findings.report(times.target_in_step(op.signal, name, place))


def _unused_equations(model: Model) -> None:
    """Lowers the equations that nothing needs, so that their mistakes are found too."""
    for name, entry in model.spec.equations.items():
        with suppress(LoweringFailed):
            model.entries.value(name, entry, _STEP, entry.place.key)


def _report_unused(model: Model) -> None:
    for name, declared in model.scope.items():
        if name not in model.used and declared.kind in _EXPECTED_IN_USE:
            place = declared.entry.place.key
            model.findings.report(names.unused_entry(name, declared.kind.value, place))


_EXPECTED_IN_USE = frozenset(
    {Kind.INPUT, Kind.CONSTANT, Kind.PARAMETER, Kind.LAYER, Kind.FUNCTION, Kind.EQUATION}
)


def _losses(model: Model, outputs: list[Output]) -> list[Loss]:
    if not model.spec.losses:
        return [default_loss(model, output) for output in outputs if output.predicts]
    found: list[Loss] = []
    for name, entry in model.spec.losses.items():
        try:
            found.extend(lower_loss(model, name, entry))
        except LoweringFailed:
            continue
    return found


def _signals(model: Model) -> tuple[Signal, ...]:
    declared = [
        *((Role.INPUT, name, entry) for name, entry in model.spec.inputs.items()),
        *((Role.TARGET, name, entry) for name, entry in model.spec.targets.items()),
        *((Role.TARGET, name, entry) for name, entry in model.measured.items()),
    ]
    return tuple(
        Signal(
            name=name,
            role=role,
            axes=model.arrays.axes_of(entry),
            unit=entry.unit.value if entry.unit else None,
            range=entry.range.value if entry.range else None,
            on_invalid=entry.on_invalid if isinstance(entry, SignalEntry) else "flag",
            doc=entry.doc or "",
            span=entry.place.key,
        )
        for role, name, entry in declared
    )
