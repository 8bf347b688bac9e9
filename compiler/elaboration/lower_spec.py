"""Lowers every entry of a spec, repeatedly until the lengths of its buffers converge."""

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
    """All entries of a spec as nodes of the graphs."""

    elaborated: Elaboration
    outputs: list[Output]
    states: list[State]
    losses: list[Loss]
    ranges: dict[str, tuple[float, float]]
    expected: list[Expected]


_MOST_LOWERINGS = 100
"""Maximum number of repetitions. Two or three suffice for most specs; in the worst case every
repetition settles one equation."""


def lower_spec(linked: Linked, draw: int) -> LoweredSpec:
    """Lowers the spec until the buffers that it needs equal those that it was lowered with.

    Buffer lengths, and axes of equations that read their own past, are known only after lowering: a
    function, layer or sub-model may delay its argument. The same holds for the unit of fuzzy
    centres that are read before a call of their layer. All other facts come from the text.
    """
    variables = gradient_variables(linked.spec) | implicit_equations(linked)
    known = FoundBefore()
    for _ in range(_MOST_LOWERINGS):
        # start with new graphs: the old ones have nodes for buffers of the wrong length
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
    if not context.findings.failed:  # after a mistake, entries may be unused because of it
        report_unused(context)
    return lowered


def _lowered_once(elaborated: Elaboration) -> LoweredSpec:
    context = elaborated.context
    outputs = _outputs(elaborated)
    ranges = signal_ranges(context)
    states = _states(elaborated, ranges)
    # after outputs and states: a loss may read arrays that a layer creates when it is called
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
        context.used.add(name)  # also equations, which the export names
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
    """The equations that an export lists as outputs, in the order of the spec."""
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
        # even if `next` failed: `init` may have mistakes of its own
        try:
            first = declared.start(name, entry, start)
        except LoweringFailed:
            continue
        if following is None or type is None:
            continue
        needs: tuple[str, ...] = ()
        # if an export prunes a sub-model that `next` needs, the state becomes a port (R13)
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
        # a reset can happen at any step, when the log around the start is gone
        if entry.range_policy == "reset" and (estimated or reads_log(start.graph(), first)):
            place = entry.init.place.value if entry.init is not None else entry.place.key
            report = state_errors.reset_to_the_log(name, place, fitted=estimated)
            context.findings.report(report)
    return found


def _report_log_reads(context: Context, outputs: list[Output], table: list[State]) -> None:
    """Reports outputs and their states that read the log: a deployed step has none. Losses may."""
    graph = context.builder(STEP).graph()
    following = {state.name: state.next for state in table}
    _, deployed = needed_over_time(graph, following, [output.node for output in outputs])
    results = [(output.name, output.node, output.span) for output in outputs]
    results += [(s.name, s.next, s.span) for s in table if s.name in deployed]
    of_log = [index for index, node in graph if isinstance(node.op, ReadLog)]
    kept = needed(graph, [node for _, node, _ in results])
    # one search for all outputs suffices for most specs; the one per output is slow
    if not any(kept[index] for index in of_log):
        return
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
