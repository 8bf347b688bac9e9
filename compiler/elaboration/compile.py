"""Compiles a spec: lowers every entry, reports every mistake of the stage, verifies the program."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import partial

from compiler.elaboration.between_samples import report_between
from compiler.elaboration.control.control_problem import asked_control, control_problem
from compiler.elaboration.deep_recursion import room_for
from compiler.elaboration.estimation.estimation_problem import estimation_problem
from compiler.elaboration.fitted_starts import check_fitted_starts, fit_over
from compiler.elaboration.formulas import formulas_of
from compiler.elaboration.found_before import FoundBefore
from compiler.elaboration.gradient_variables import gradient_variables, implicit_equations
from compiler.elaboration.losses.losses import default_loss, lower_loss
from compiler.elaboration.losses.penalties import checked_penalties
from compiler.elaboration.names import Elaboration
from compiler.elaboration.signals import logged_signals
from compiler.elaboration.submodels.needed_submodels import needed_submodels
from compiler.elaboration.unused import lower_unused, report_unused
from compiler.interpreter.never_finite import never_finite
from compiler.ir.builder import GraphBuilder
from compiler.ir.liveness import needed, needed_over_time, reads_log
from compiler.ir.ops import ReadLog
from compiler.ir.program import Declared, Dimension, Expected, Loss, Output, Program, State
from compiler.linking.link import Linked, WeightsByPart, link
from compiler.lowering.context import Context
from compiler.lowering.environment import Environment, EnvironmentPart
from compiler.lowering.failure import LoweringFailed
from compiler.lowering.predictions import as_predicted, prediction_of
from compiler.lowering.ranges import expected_values, signal_ranges
from compiler.lowering.scope import owner_of
from compiler.optimal_control.problem import ControlProblem
from compiler.passes import run_passes
from compiler.passes.analyses.infinite_slopes import infinite_slopes
from compiler.state_estimation.problem import EstimationProblem
from spec_schema.diagnostics.diagnostic import Diagnostic, Findings, SpecError
from spec_schema.errors import states as state_errors
from spec_schema.errors import time as times
from spec_schema.errors import units
from spec_schema.expressions.tree import Name
from spec_schema.reading.reader import ReadResult
from spec_schema.sections import signals
from spec_schema.sections.references import names_in
from spec_schema.sections.spec import Spec

UNIT_WARNINGS = ("W0504", "W0505", "W0737")
"""What `strict_units` refuses."""

_STEP = Environment(EnvironmentPart.STEP)
_START = Environment(EnvironmentPart.START)


@dataclass(frozen=True)
class Compiled:
    """A program and what is worth saying about the spec that it came from."""

    program: Program
    spec: Spec
    """With the entries of sub-models under their full names."""
    warnings: tuple[Diagnostic, ...]
    control: ControlProblem | None = None
    """Of the `mpc` section, where there is one."""
    estimation: EstimationProblem | None = None
    """Of the `estimator` section, where there is one."""


def compile_spec(
    spec: Spec,
    *,
    used: Mapping[str, ReadResult] | None = None,
    weights: WeightsByPart | None = None,
    numbers: Mapping[str, str] | None = None,
    strict_units: bool = False,
    spec_hash: str = "",
    draw: int = 0,
) -> Compiled:
    """The program of a spec, in window form.

    `used` is what was read for its sub-models and `weights` the arrays of those with `weights:`, by
    their full names; without them a sub-model has its initial values. `numbers` has the texts of
    files of initial values, by path; those that are not there are read.
    Raises SpecError with every mistake found; with `strict_units` units that do not fit are errors.
    Another `draw` has other initial values where they are drawn.
    """
    problems = Findings()
    try:
        linked = replace(link(spec, used or {}, weights or {}, problems), numbers=numbers or {})
        problems.raise_errors()
        compile_it = partial(compile_linked, strict_units=strict_units, draw=draw)
        compiled = compile_it(linked, spec_hash=spec_hash)
        return _with_problems(linked, compiled, compile_it)
    except SpecError as error:
        raise SpecError(in_own_files(error.diagnostics, spec, used or {}, numbers)) from None


def compile_linked(
    linked: Linked, *, strict_units: bool = False, spec_hash: str = "", draw: int = 0
) -> Compiled:
    """The program of a spec in which everything has its full name; otherwise as `compile_spec`."""
    spec = linked.spec
    with room_for(len(spec.equations) + len(spec.outputs)):
        lowered = _lowered(linked, draw)
    elaborated, context = lowered.elaborated, lowered.elaborated.context
    refused = [d for d in context.findings.in_order if d.code in UNIT_WARNINGS]
    if strict_units and refused:
        context.findings.report(units.strict_units(len(refused)))
    parameters = elaborated.arrays.parameters
    losses = checked_penalties(lowered.losses, parameters, context.findings)
    diagnostics = context.findings.in_order
    if any(d.severity == "error" for d in diagnostics):
        raise SpecError(diagnostics)
    # What failed without a diagnostic would silently be missing.
    wanted = {*spec.outputs, *_exported_equations(spec)}
    assert {output.name for output in lowered.outputs} == wanted, "an output was lost"
    assert {state.name for state in lowered.states} >= spec.states.keys(), "a state was lost"
    program = Program(
        name=spec.name.value,
        sample_time=context.sampling.sample_time,
        signals=logged_signals(context, lowered.ranges),
        parameters=parameters,
        states=tuple(lowered.states),
        step=context.builder(_STEP).graph(),
        start=context.builder(_START).graph(),
        outputs=tuple(lowered.outputs),
        losses=tuple(losses),
        expected=tuple(lowered.expected),
        fits=tuple(elaborated.layers.fits.values()),
        dimensions=tuple(Dimension(n, d.size, d.labels) for n, d in spec.dims.items()),
        formulas=formulas_of(spec),
        doc=spec.doc or "",
        spec_hash=spec_hash,
    )
    program = run_passes(program)
    found = (*never_finite(program), *infinite_slopes(program))
    return Compiled(program, spec, (*diagnostics, *found))


def _with_problems(
    linked: Linked, compiled: Compiled, compile_it: Callable[[Linked], Compiled]
) -> Compiled:
    """The same with the problems of its sections `mpc` and `estimator`."""
    spec = linked.spec
    if spec.mpc is not None:
        asked = asked_control(linked, spec.mpc)
        whole = compile_it(asked.linked)
        more = [found for found in whole.warnings if found not in compiled.warnings]
        program = replace(whole.program, spec_hash=compiled.program.spec_hash)
        control, said = control_problem(asked, program, more)
        compiled = replace(compiled, control=control, warnings=(*compiled.warnings, *said))
    if spec.estimator is not None:
        estimation = estimation_problem(spec, spec.estimator, compiled.program)
        compiled = replace(compiled, estimation=estimation)
    return compiled


def in_own_files(
    diagnostics: Iterable[Diagnostic],
    spec: Spec,
    used: Mapping[str, ReadResult],
    numbers: Mapping[str, str] | None = None,
) -> tuple[Diagnostic, ...]:
    """The diagnostics with those of a broken sub-model as its own file alone brings them.

    There names are as its author wrote them; beside each stands where the file is used.
    """
    broken: dict[str, tuple[Diagnostic, ...]] = {}
    for name, file in used.items():
        path = file.source.path
        if path in broken:
            continue
        try:
            compile_spec(file.spec, used=file.used, numbers=numbers)
        except SpecError as error:
            place, label = spec.use[name].file.span, f"used here as `{name}`"
            broken[path] = tuple(d.seen_from(place, label) for d in error.diagnostics)
    read = [file for file in used.values() if file.source.path in broken]
    files = {source.path for file in read for source in file.sources}
    others = (d for d in diagnostics if d.span is None or d.span.file not in files)
    return (*(d for found in broken.values() for d in found), *others)


@dataclass(frozen=True)
class _Lowered:
    """Everything of a spec as nodes of the graphs."""

    elaborated: Elaboration
    outputs: list[Output]
    states: list[State]
    losses: list[Loss]
    ranges: dict[str, tuple[float, float]]
    expected: list[Expected]


_MOST_LOWERINGS = 100
"""Lengths and axes of buffers settle in two or three, later by at most one equation a lowering."""


def _lowered(linked: Linked, draw: int) -> _Lowered:
    """The spec lowered until the buffers that it needs are those that it has.

    So is the unit of centres that are read before a call of their layer tells it. How far back
    something is read, and which axes an equation that reads its own past has, is known only of
    lowered expressions: a function, a layer or a sub-model may delay its argument. Nothing else
    iterates. What the text alone shows, as whose gradients are taken, is read from it.
    """
    variables = gradient_variables(linked.spec) | implicit_equations(linked)
    known = FoundBefore()
    for _ in range(_MOST_LOWERINGS):
        lowered = _lowered_once(Elaboration(linked, variables, known, draw))
        found = lowered.elaborated.found()
        if found == known:
            break
        known = found
    else:
        raise AssertionError("the buffers of a spec do not settle")
    context = lowered.elaborated.context
    lowered.states.extend(lowered.elaborated.histories.states())
    lowered.states.extend(context.memories.states)
    context.given.report(lowered.elaborated.arrays.all_names)
    check_fitted_starts(context, lowered.states, lowered.losses)
    _report_log_reads(context, lowered.outputs, lowered.states)
    report_between(context)
    if linked.spec.mpc is not None:
        context.used.update(names_in(linked.spec.mpc))
    if not context.findings.failed:  # what is left unused by a mistake is no news
        report_unused(context)
    return lowered


def _lowered_once(elaborated: Elaboration) -> _Lowered:
    context = elaborated.context
    outputs = _outputs(elaborated)
    ranges = signal_ranges(context)
    states = _states(elaborated, ranges)
    losses = _losses(context, outputs)
    lower_unused(elaborated)
    return _Lowered(elaborated, outputs, states, losses, ranges, expected_values(context))


def _outputs(elaborated: Elaboration) -> list[Output]:
    context = elaborated.context
    found: list[Output] = []
    for name, entry in {**context.spec.outputs, **_exported_equations(context.spec)}.items():
        predicts = None
        context.used.add(name)  # an equation too, by the export that names it
        try:
            node = elaborated.entries.value(name, entry, _STEP, entry.place.key)
            if isinstance(entry, signals.Output) and entry.predicts is not None:
                predicts = prediction_of(context, entry.predicts, "predicts")
                node = as_predicted(context, name, entry, node, predicts)
        except LoweringFailed:
            continue
        needs = needed_submodels(context.spec, Name(name, entry.place.key))
        found.append(Output(name, node, predicts, entry.doc or "", entry.place.key, needs))
    return found


def _exported_equations(spec: Spec) -> dict[str, signals.Equation]:
    """The equations that an export names among its outputs, in the order of the spec."""
    names = spec.export.named_outputs if spec.export is not None else frozenset[str]()
    return {name: entry for name, entry in spec.equations.items() if name in names}


def _states(elaborated: Elaboration, ranges: Mapping[str, tuple[float, float]]) -> list[State]:
    context, declared = elaborated.context, elaborated.states
    found: list[State] = []
    start: GraphBuilder = context.builder(_START)
    for name, entry in context.spec.states.items():
        try:
            type = context.type_of(entry)
            following = declared.next(name, entry)
        except LoweringFailed:
            following, type = None, None
        try:
            first = declared.start(name, entry, start)
        except LoweringFailed:
            continue
        if following is None or type is None:
            continue
        needs: tuple[str, ...] = ()
        if entry.next is not None and entry.der is None and not owner_of(name):
            needs = needed_submodels(context.spec, entry.next)
        found.append(
            State(
                name=name,
                axes=type.axes,
                unit=type.unit,
                origin=Declared(),
                next=following,
                start=first,
                range=ranges.get(name),
                doc=entry.doc or "",
                span=entry.place.key,
                on_range=entry.range_policy,
                needs=needs,
                fit_over=fit_over(context, entry),
            )
        )
        estimated = entry.init is not None and entry.init.fit is not None
        if entry.range_policy == "reset" and (estimated or reads_log(start.graph(), first)):
            place = entry.init.place.value if entry.init is not None else entry.place.key
            report = state_errors.reset_to_the_log(name, place, fitted=estimated)
            context.findings.report(report)
    return found


def _report_log_reads(context: Context, outputs: list[Output], table: list[State]) -> None:
    """A deployed step has no log: outputs and their states must do without (losses need not)."""
    graph = context.builder(_STEP).graph()
    following = {state.name: state.next for state in table}
    _, deployed = needed_over_time(graph, following, [output.node for output in outputs])
    results = [(output.name, output.node, output.span) for output in outputs]
    results += [(s.name, s.next, s.span) for s in table if s.name in deployed]
    of_log = [index for index, node in graph if isinstance(node.op, ReadLog)]
    kept = needed(graph, [node for _, node, _ in results])
    if not any(kept[index] for index in of_log):
        return  # nearly always: who reads the log is looked for only where somebody does
    reported: set[int] = set()
    for name, node, span in results:
        kept = needed(graph, (node,))
        for index in of_log:
            op = graph[index].op
            if kept[index] and isinstance(op, ReadLog) and index not in reported:
                place = graph[index].span or span
                assert place is not None
                reported.add(index)
                context.findings.report(times.target_in_step(op.signal, name, place))


def _losses(context: Context, outputs: list[Output]) -> list[Loss]:
    if not context.spec.losses:
        return [default_loss(context, output) for output in outputs if output.predicts]
    found: list[Loss] = []
    for name, entry in context.spec.losses.items():
        try:
            found.extend(lower_loss(context, name, entry))
        except LoweringFailed:
            continue
    return found
