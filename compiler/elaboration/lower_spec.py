"""Lowers every entry of a spec into nodes, again until the buffers settle that it needs."""

from __future__ import annotations

from collections.abc import Mapping

from compiler.elaboration.fitted_starts import check_fitted_starts, fit_over
from compiler.elaboration.gradient_variables import gradient_variables, implicit_equations
from compiler.elaboration.integrators.between_samples import report_between
from compiler.elaboration.losses.losses import default_loss, lower_loss
from compiler.elaboration.named_values.found_before import FoundBefore
from compiler.elaboration.named_values.names import Elaboration
from compiler.elaboration.section import section_of
from compiler.elaboration.submodels.needed_submodels import needed_submodels
from compiler.elaboration.unused import lower_unused, report_unused
from compiler.ir.builder import GraphBuilder
from compiler.ir.liveness import needed, needed_over_time, reads_log
from compiler.ir.ops import ReadLog
from compiler.ir.program import Declared, Expected, Loss, Output, State
from compiler.linking.link import Linked
from compiler.lowering.context import Context
from compiler.lowering.environment import START, STEP
from compiler.lowering.failure import LoweringFailed
from compiler.lowering.places.predictions import as_predicted, prediction_of
from compiler.lowering.ranges import expected_values, signal_ranges
from compiler.lowering.scope import owner_of
from spec_schema.errors import states as state_errors
from spec_schema.errors import time as times
from spec_schema.expressions.tree import Name
from spec_schema.late_dataclass import dataclass
from spec_schema.sections import signals
from spec_schema.sections.spec import Spec


@dataclass(frozen=True, kw_only=True)
class LoweredSpec:
    """Everything of a spec as nodes of the graphs."""

    elaborated: Elaboration
    outputs: list[Output]
    states: list[State]
    losses: list[Loss]
    ranges: dict[str, tuple[float, float]]
    expected: list[Expected]


_MOST_LOWERINGS = 100
"""Lengths and axes of buffers settle in two or three, later by at most one equation a lowering."""


def lower_spec(linked: Linked, draw: int) -> LoweredSpec:
    """The spec lowered until the buffers that it needs are those that it has.

    So is the unit of centres that are read before a call of their layer tells it. How far back
    something is read, and which axes an equation that reads its own past has, is known only of
    lowered expressions: a function, a layer or a sub-model may delay its argument. Nothing else
    iterates. What the text alone shows, as whose gradients are taken, is read from it.
    """
    variables = gradient_variables(linked.spec) | implicit_equations(linked)
    known = FoundBefore()
    for _ in range(_MOST_LOWERINGS):
        # all graphs anew: nodes that stand for a buffer of the wrong length are in the old ones
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
    for line, entry in linked.spec.sections():
        context.used.update(section_of(line).names_used(entry))
    if not context.findings.failed:  # what is left unused by a mistake is no news
        report_unused(context)
    return lowered


def _lowered_once(elaborated: Elaboration) -> LoweredSpec:
    context = elaborated.context
    outputs = _outputs(elaborated)
    ranges = signal_ranges(context)
    states = _states(elaborated, ranges)
    # after outputs and states: the arrays that a loss reads of a layer exist once it was called
    losses = _losses(context, outputs)
    lower_unused(elaborated)
    return LoweredSpec(
        elaborated=elaborated,
        outputs=outputs,
        states=states,
        losses=losses,
        ranges=ranges,
        expected=expected_values(context),
    )


def _outputs(elaborated: Elaboration) -> list[Output]:
    context = elaborated.context
    found: list[Output] = []
    for name, entry in {**context.spec.outputs, **exported_equations(context.spec)}.items():
        predicts = None
        context.used.add(name)  # an equation too, by the export that names it
        try:
            node = elaborated.entries.value(name, entry, STEP, entry.place.key)
            if isinstance(entry, signals.Output) and entry.predicts is not None:
                predicts = prediction_of(context, entry.predicts, "predicts")
                node = as_predicted(context, name, entry, node, predicts)
        except LoweringFailed:
            continue
        needs = needed_submodels(context.spec, Name(name, entry.place.key))
        found.append(
            Output(
                name=name,
                node=node,
                predicts=predicts,
                doc=entry.doc or "",
                span=entry.place.key,
                needs=needs,
            )
        )
    return found


def exported_equations(spec: Spec) -> dict[str, signals.Equation]:
    """The equations that an export names among its outputs, in the order of the spec."""
    names = spec.export.named_outputs if spec.export is not None else frozenset[str]()
    return {name: entry for name, entry in spec.equations.items() if name in names}


def _states(elaborated: Elaboration, ranges: Mapping[str, tuple[float, float]]) -> list[State]:
    context, declared = elaborated.context, elaborated.states
    found: list[State] = []
    start: GraphBuilder = context.builder(START)
    for name, entry in context.spec.states.items():
        try:
            type = context.type_of(entry)
            following = declared.next(name, entry)
        except LoweringFailed:
            following, type = None, None
        # even where `next` failed: `init` has mistakes of its own to tell
        try:
            first = declared.start(name, entry, start)
        except LoweringFailed:
            continue
        if following is None or type is None:
            continue
        needs: tuple[str, ...] = ()
        # a discrete state whose `next` needs what an export prunes becomes a port of it (R13)
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
        # a reset may come at any step of a run; the log around its start is not there any more
        if entry.range_policy == "reset" and (estimated or reads_log(start.graph(), first)):
            place = entry.init.place.value if entry.init is not None else entry.place.key
            report = state_errors.reset_to_the_log(name, place, fitted=estimated)
            context.findings.report(report)
    return found


def _report_log_reads(context: Context, outputs: list[Output], table: list[State]) -> None:
    """A deployed step has no log: outputs and their states must do without (losses need not)."""
    graph = context.builder(STEP).graph()
    following = {state.name: state.next for state in table}
    _, deployed = needed_over_time(graph, following, [output.node for output in outputs])
    results = [(output.name, output.node, output.span) for output in outputs]
    results += [(s.name, s.next, s.span) for s in table if s.name in deployed]
    of_log = [index for index, node in graph if isinstance(node.op, ReadLog)]
    kept = needed(graph, [node for _, node, _ in results])
    # which node needs which log is a search an output; one search for all answers most specs
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
