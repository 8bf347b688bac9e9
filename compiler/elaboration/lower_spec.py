"""Lowers every entry of a spec. This is repeated until the lengths of the buffers no
longer change.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from typing import Any

from compiler.differentiation.estimated_starts import evaluations_that_decide
from compiler.elaboration.integration import report_between
from compiler.elaboration.losses import default_loss, lower_loss
from compiler.elaboration.names import Elaboration
from compiler.elaboration.section import section_of
from compiler.elaboration.states import FoundBefore
from compiler.ir.builder import GraphBuilder
from compiler.ir.nodes import needed, needed_over_time, reads_log
from compiler.ir.ops import ReadLog
from compiler.ir.program import Declared, Expected, Loss, Measure, Output, State
from compiler.ir.types import Type
from compiler.linking.link import Connected, Linked
from compiler.lowering.constants import expected_values, signal_ranges
from compiler.lowering.context import Context, Kind, LoweringFailed, owner_of
from compiler.lowering.environment import START, STEP
from compiler.lowering.expressions import lower
from compiler.lowering.places import as_predicted, prediction_of
from spec_schema.diagnostics.diagnostic import Diagnostic
from spec_schema.diagnostics.source import Span
from spec_schema.errors import names
from spec_schema.errors import states as errors
from spec_schema.errors import states as state_errors
from spec_schema.errors import time as times
from spec_schema.expressions.tree import Call, Expression, LanguageName, Name, Number
from spec_schema.late_dataclass import dataclass
from spec_schema.sections import signals
from spec_schema.sections.layers import Layer
from spec_schema.sections.references import calls_in, names_in
from spec_schema.sections.spec import Spec


@dataclass(frozen=True, kw_only=True)
class LoweredSpec:
    """All entries of a spec after lowering: outputs, states, losses, ranges and expected ranges.
    Their nodes are in the graphs of `elaborated`.
    """

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
    """Lowers all entries of a linked spec, again and again until the buffers that it needs equal
    those that it assumed.

    `draw` selects random initial values. Buffer lengths, and axes of equations that read their own
    past, are known only after lowering: a function, layer or sub-model may delay its argument. The
    same holds for the unit of fuzzy centres that are read before a call of their layer. Mistakes
    are collected in the context's findings.
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
    """The equations that the section `export:` lists as outputs, by name, in the order of
    the spec.
    """
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
    """Reports outputs that read the log, directly or through the states `table`: a deployed step
    has no log. Losses may read it.
    """
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


def fit_over(context: Context, entry: signals.State) -> int | None:
    """Number of first samples of a run from which the initial value of a state is estimated; 0 for
    the whole run. None if it is not estimated or if the length has a mistake.
    """
    if entry.init is None or entry.init.fit is None:
        return None
    over = entry.init.fit.over
    if over == "record":
        return 0
    try:
        return context.sampling.samples(over)
    except LoweringFailed:
        return None


def check_fitted_starts(context: Context, states: Sequence[State], losses: Sequence[Loss]) -> None:
    """Reports estimated initial values of `states` that have fewer samples than unknowns, or no
    loss in `losses` from which they could be estimated.
    """
    estimated = [state for state in states if state.fit_over is not None]
    numbers = sum(Type(state.axes).size for state in estimated)
    most = evaluations_that_decide(estimated)
    # one report for all of them, at the first one
    for state in estimated[:1]:
        entry = context.spec.states[state.name]
        assert entry.init is not None
        assert entry.init.fit is not None
        names = [one.name for one in estimated]
        # fewer equations than unknowns: the estimate would not be unique
        over = entry.init.fit.over
        if most is not None and most < numbers and over != "record":
            place = over.span
            context.findings.report(errors.too_few_for_starts(names, most, numbers, place))
        # a loss with a mistake of its own is reported already and may compare with data
        known = _entries_with_loss(context) <= {loss.entry for loss in losses}
        if known and all(loss.measure is Measure.MEAN for loss in losses):
            place = entry.init.fit.place.key
            context.findings.report(errors.starts_of_nothing(state.name, place))


def _entries_with_loss(context: Context) -> set[str]:
    """The names of the entries of `losses:`, or without them of the outputs that have a default
    loss.
    """
    predicting = {name for name, output in context.spec.outputs.items() if output.predicts}
    return {*context.spec.losses} if context.spec.losses else predicting


def gradient_variables(spec: Spec) -> frozenset[str]:
    """Names of equations and outputs that are the variable x of some `grad(y, x)` in the spec.

    A function may pass x as an argument: `f(e)` with the formula `grad(a**2, a)` has the variable
    e. All formulas are searched, including those of unused functions.
    """
    values = spec.equations.keys() | spec.outputs.keys()
    model = (spec.states, spec.equations, spec.outputs, spec.layers, spec.losses)
    waiting = [(call, _NO_ARGUMENTS) for call in calls_in(model)]
    for function in spec.functions.values():
        # the arguments of a function without a call are unknown; no entry is named ""
        unknown = {argument.value: "" for argument in function.args}
        waiting += [(call, unknown) for call in calls_in(function)]
    found: set[str] = set()
    entered: set[tuple[str, tuple[str, ...]]] = set()
    while waiting:
        call, arguments = waiting.pop()
        name = call.function.name if isinstance(call.function, Name) else ""
        function = None if isinstance(call.function, LanguageName) else spec.functions.get(name)
        if function is None:
            if name == "grad" and name not in spec.layers and len(call.arguments) == 2:
                found.add(_variable(call.arguments[1], arguments))
            continue
        parameters = [argument.value for argument in function.args]
        given = {
            key: _variable(value, arguments) for key, value in _named_arguments(call, parameters)
        }
        key = name, tuple(given.get(argument, "") for argument in parameters)
        # recursion, which is reported later, would not terminate
        if key not in entered:
            entered.add(key)
            waiting += [(inner, given) for inner in calls_in(function)]
    return frozenset(found & values)


def implicit_equations(linked: Linked) -> frozenset[str]:
    """Full names of the equations that an integrator treats implicitly: those of `linear_implicit:
    {of: NAME}`.
    """
    found: set[str] = set()
    for owner, integrator in linked.integrators.items():
        method = integrator.linear_implicit if integrator is not None else None
        if method is not None and method.of is not None:
            found.add(f"{owner}.{method.of.value}" if owner else method.of.value)
    return frozenset(found)


_NO_ARGUMENTS: Mapping[str, str] = {}


def _named_arguments(call: Call, wanted: list[str]) -> Iterator[tuple[str, Expression]]:
    yield from zip(wanted, call.arguments, strict=False)
    yield from ((keyword.name, keyword.value) for keyword in call.keywords)


def _variable(expression: Expression, arguments: Mapping[str, str]) -> str:
    """The name that an expression consists of; for an argument of a function, the name in
    `arguments` that was passed for it. "" for any other expression.
    """
    if not isinstance(expression, Name):
        return ""
    return arguments.get(expression.name, expression.name)


def needed_submodels(spec: Spec, expression: Expression) -> tuple[str, ...]:
    """Names of the sub-models on which an expression of the model depends in the same step.

    Reading a parameter or a layer of a sub-model does not count: a controller may share them.
    """
    if not spec.use:
        return ()
    needed: dict[str, None] = {}
    seen: set[str] = set()
    waiting: list[Any] = [expression]
    while waiting:
        for name in names_in(waiting.pop()):
            if name in seen:
                continue
            seen.add(name)
            entry = spec.equations.get(name) or spec.outputs.get(name) or spec.states.get(name)
            if entry is not None and "." in name and not isinstance(entry, Connected):
                needed[name.partition(".")[0]] = None
            for section in (spec.equations, spec.outputs, spec.functions):
                if name in section:
                    waiting.append(section[name].expr)
            if name in spec.layers:
                waiting.append(spec.layers[name])
    return tuple(needed)


_EXPECTED_IN_USE = frozenset(
    {Kind.INPUT, Kind.CONSTANT, Kind.PARAMETER, Kind.LAYER, Kind.FUNCTION, Kind.EQUATION}
)


def lower_unused(elaborated: Elaboration) -> None:
    """Lowers entries that nothing uses, so that their mistakes are reported, too; `elaborated` is
    the lowering of the others.

    For sub-models only equations are lowered; compiling their own files reports the rest.
    """
    context = elaborated.context
    for name, entry in context.spec.equations.items():
        with suppress(LoweringFailed):
            elaborated.entries.value(name, entry, STEP, entry.place.key)
    for name, constant in context.spec.constants.items():
        if name not in context.used and not owner_of(name):
            with suppress(LoweringFailed):
                elaborated.constants.value(name, constant)
    _report_parameters(elaborated)
    for name, layer in context.spec.layers.items():
        if name not in context.used and not owner_of(name):
            _report_layer(elaborated, name, layer)
    for name, function in context.spec.functions.items():
        if name not in context.used and not owner_of(name):
            found = _found_by_calling(elaborated, name, len(function.args))
            # the shapes and units of its arguments are unknown
            context.findings.report(*(d for d in found if d.code in _OF_NAMES))
    if context.unread:
        _report_unread(elaborated)


def _report_unread(elaborated: Elaboration) -> None:
    """Reports unknown names in arguments of calls that the formula of the called function does not
    use.
    """
    apart = elaborated.afresh(FoundBefore())
    for argument in elaborated.context.unread:
        there = argument.environment
        with suppress(LoweringFailed):
            lower(apart.context, argument.expression, there.in_graph_of(there.part))
    # other errors may be caused by the missing buffers of the program
    found = (d for d in _errors_of(apart) if d.code in _OF_NAMES)
    elaborated.context.findings.report(*found)


def _report_parameters(elaborated: Elaboration) -> None:
    """Reports mistakes in parameters that nothing uses."""
    context = elaborated.context
    unused = {
        name: entry
        for name, entry in context.spec.parameters.items()
        if name not in context.used and not owner_of(name)
    }
    if not unused:
        return
    # the first use declares a parameter: a separate elaboration keeps them out of the program
    apart = elaborated.afresh(FoundBefore())
    for name, entry in unused.items():
        with suppress(LoweringFailed):
            apart.arrays.parameter(name, entry)
    context.findings.report(*_errors_of(apart))


# findings at this place concern the artificial call, not the spec
_NOWHERE = Span(file="", line=0, column=0, end_line=0, end_column=0)
# names, argument counts, misplaced calls: wrong for any arguments
_OF_NAMES = frozenset(
    {"E0301", "E0303", "E0304", "E0305", "E0306", "E0307", "E0319", "E0349", "E0350"}
)
# axes: a call with other arguments may be right, since options can have their dims; only an
# undeclared dimension (E0405) is wrong in any case
_OF_AXES = frozenset({"E0401", "E0402", "E0403", "E0404", "E0406", "E0407", "E0408"})


def _report_layer(elaborated: Elaboration, name: str, entry: Layer) -> None:
    """Reports the mistakes of an unused layer that do not depend on its arguments."""
    found = _found_by_calling(elaborated, name, 1)
    if any(d.span == _NOWHERE for d in found):  # such as a table in two dimensions
        found = _found_by_calling(elaborated, name, 2)
    elaborated.context.findings.report(
        *(d for d in found if d.span != _NOWHERE and d.code not in _OF_AXES)
    )


def _found_by_calling(elaborated: Elaboration, name: str, count: int) -> list[Diagnostic]:
    """The errors of a call of `name` with `count` zeros, which fit every unit.

    The call is lowered in separate graphs, so that its nodes, arrays and states do not remain. If
    it reads the past, it is lowered once more with its buffers, to check how they are initialised.
    """
    zeros = tuple(Number(0.0, _NOWHERE) for _ in range(count))
    call = Call(Name(name, _NOWHERE), zeros, (), _NOWHERE)
    attempt = _lowered_alone(elaborated, call, FoundBefore())
    known = attempt.found()
    if known.buffers:
        attempt = _lowered_alone(elaborated, call, known)
        # only for its reports: buffers without initial values
        attempt.histories.states()
    return _errors_of(attempt)


def _errors_of(attempt: Elaboration) -> list[Diagnostic]:
    return [d for d in attempt.context.findings.in_order if d.severity == "error"]


def _lowered_alone(elaborated: Elaboration, call: Call, known: FoundBefore) -> Elaboration:
    attempt = elaborated.afresh(known)
    with suppress(LoweringFailed):
        lower(attempt.context, call, STEP)
    return attempt


def report_unused(context: Context) -> None:
    """Warns about entries of the model, not of sub-models, that nothing refers to."""
    for name, declared in context.scope.items():
        # entries of sub-models may be unused here
        expected = declared.kind in _EXPECTED_IN_USE and not owner_of(name)
        if expected and name not in context.used:
            place = declared.entry.place.key
            context.findings.report(names.unused_entry(name, declared.kind.value, place))
