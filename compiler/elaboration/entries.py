"""Lowers equations, outputs, constants, calls of functions, and connected inputs to nodes."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from compiler.elaboration.states import Histories
from compiler.ir.builder import GraphBuilder
from compiler.ir.program import NodeId
from compiler.ir.rules import same_unit
from compiler.ir.types import WINDOW, Type, describe_axes
from compiler.linking.link import Connected
from compiler.lowering.constants import NamedArray, dims_repair, evaluate, refuse_infinite, shaped
from compiler.lowering.context import Context, LoweringFailed
from compiler.lowering.environment import (
    STEP,
    Environment,
    EnvironmentPart,
    FunctionArgument,
    IntegratorStage,
    Time,
)
from compiler.lowering.expressions import lower, report_declared_unit
from spec_schema.diagnostics.source import Span
from spec_schema.errors import names, states
from spec_schema.errors import submodels as errors
from spec_schema.expressions.tree import Call, Expression
from spec_schema.sections.signals import Equation, Output
from spec_schema.sections.values import Constant, Function


class Entries:
    """The equations and outputs of one compilation, each lowered once per time and integrator
    stage. `variables` are the names by which some `grad` differentiates.
    """

    def __init__(self, context: Context, histories: Histories, variables: frozenset[str]) -> None:
        self._context = context
        self._histories = histories
        self._variables = variables
        # the key includes the stage: an equation differs between stages of an integrator (R6)
        self._entries: dict[
            tuple[str, EnvironmentPart, Time, IntegratorStage | None], NodeId | None
        ] = {}
        self._lowerings: dict[tuple[str, EnvironmentPart], list[tuple[Time, NodeId]]] = {}
        """Lowerings outside integrator stages, by name."""
        self._active: dict[str, None] = {}
        """The entries being lowered, outermost first."""
        self._loops: list[set[str]] = []
        """Reported algebraic loops, so that a loop entered at another member is not reported
        again."""

    def value(
        self, name: str, entry: Equation | Output, environment: Environment, span: Span
    ) -> NodeId:
        """The node of an equation or output in an environment, lowered once per time and stage.
        `span` is the place that reads it.

        At a time other than t, every signal in it is read at that time (R1). If that is impossible,
        since it depends on a state or on itself, a buffer stores its past values. Raises
        LoweringFailed after reporting a mistake.
        """
        own = environment.of_entry()
        stage = own.stage
        if isinstance(entry, Connected) and stage is not None and entry.is_held_for(stage.owner):
            own = own.without_stage()
        # before the start, `history:` takes precedence over evaluating the formula (R5a)
        if own.part is EnvironmentPart.START and own.latest < 0 and entry.history is not None:
            return lower(self._context, entry.history, own)
        if own.is_elsewhere and own.part is EnvironmentPart.STEP:
            own = own.without_stage()
            recomputed = None
            if name not in self._active and not _has_own_past(entry):
                # first choice: f(x)[t-1] = f(x[t-1]), which needs a buffer for x only
                recomputed = self.tried(lambda: self._lowered(name, entry, own, span))
            if recomputed is not None:
                return recomputed
            # a buffer ends at t; `_lowered` reports future samples that are unknown
            if own.latest <= 0:
                return self._histories.read(name, entry, span, own)
        return self._lowered(name, entry, own, span)

    def lowerings(self, name: str, environment: Environment) -> Sequence[tuple[Time, NodeId]]:
        """The nodes to which the equation or output `name` has been lowered so far, outside
        integrator stages, each with its time (shift and window).
        """
        return self._lowerings.get((name, environment.of_entry().part), ())

    def types(self) -> dict[str, Type]:
        """The type of one sample of each equation and output that has been lowered into the step,
        by name.
        """
        types: dict[str, Type] = {}
        for (name, part, (_, window), _), node in self._entries.items():
            if part is not EnvironmentPart.STEP or node is None:
                continue
            type = self._context.builder(STEP).type(node)
            if window is None:
                types[name] = type
            else:
                of_sample = tuple(axis for axis in type.axes if axis.name != WINDOW)
                types.setdefault(name, type.with_axes(of_sample))
        return types

    def tried(self, lower_it: Callable[[], NodeId]) -> NodeId | None:
        """The node that `lower_it` returns. None if it raises LoweringFailed; then its reports are
        removed, and nothing counts as failed.
        """
        mark, loops = self._context.findings.mark(), len(self._loops)
        known = len(self._entries)
        try:
            return lower_it()
        except LoweringFailed:
            # a failed attempt is not a mistake of the user
            self._context.findings.forget(mark)
            del self._loops[loops:]
            for key in list(self._entries)[known:]:
                # entries that were lowered are valid and stay
                if self._entries[key] is None:
                    del self._entries[key]
            return None

    def _lowered(self, name: str, entry: Equation | Output, own: Environment, span: Span) -> NodeId:
        key = (name, own.part, own.time, own.stage)
        if name in self._active:
            active = list(self._active)
            loop = active[active.index(name) :]
            # a loop entered at another equation has the same members
            if not any(set(loop) == known for known in self._loops):
                self._context.findings.report(states.algebraic_loop((*loop, name), span))
                self._loops.append(set(loop))
            raise LoweringFailed
        if key in self._entries:
            node = self._entries[key]
            if node is None:
                raise LoweringFailed
            return node
        self._active[name] = None
        try:
            self._entries[key] = None  # remains if lowering fails
            node = lower(self._context, entry.expr, own)
            builder = self._context.builder(own)
            if name in self._variables:
                # `2*x` elsewhere is not the variable e = 2*x, see decision 0195
                node = builder.named(node, name)
            if isinstance(entry, Connected):  # its expression has other names
                node = fitted_to_input(self._context, builder, node, name, entry, own)
            else:
                _agree_on_unit(self._context, builder, node, name, entry)
                builder.name(node, name)
            self._entries[key] = node
            # gradients use the values at samples, not those of integrator stages
            if own.stage is None:
                self._lowerings.setdefault((name, own.part), []).append((own.time, node))
        finally:
            del self._active[name]
        return node


def _has_own_past(entry: Equation | Output) -> bool:
    """True if the values before t0 come from `history:`, or for a predicting output from the log,
    instead of evaluating the formula (R5).
    """
    return entry.history is not None or (isinstance(entry, Output) and entry.predicts is not None)


def _agree_on_unit(
    context: Context, builder: GraphBuilder, node: NodeId, name: str, entry: Equation | Output
) -> None:
    """Gives the node of an entry the declared unit, in its spelling, if its own is unknown or
    equal. Reports a different one.
    """
    if entry.unit is None:
        return
    found = builder.type(node).unit
    if found is None:
        builder.set_unit(node, entry.unit.value)
    elif not same_unit(found, entry.unit.value):
        report_declared_unit(context, name, found, entry.unit.value, entry.expr.span)
    # a leaf keeps the unit that its own entry declares
    elif found.text != entry.unit.value.text and builder.node(node).args:
        builder.rename_unit(node, entry.unit.value)


class Constants:
    """The values of the entries of `constants:`, each evaluated at its first use."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._constants: dict[str, NamedArray | None] = {}
        self._active: list[str] = []
        """Constants being evaluated; meeting one of them again is a circular definition."""

    def value(self, name: str, entry: Constant) -> NamedArray:
        """The value of a `constants:` entry, with axes and unit. Raises LoweringFailed if it has a
        mistake, which is reported once.
        """
        if name in self._active:
            circle = (*self._active[self._active.index(name) :], name)
            self._context.findings.report(names.circular_constant(circle, entry.value.span))
            raise LoweringFailed
        if name not in self._constants:
            self._constants[name] = None  # remains if it fails: its mistake is reported once
            self._active.append(name)
            try:
                self._constants[name] = self._evaluated(name, entry)
            finally:
                self._active.pop()
        found = self._constants[name]
        if found is None:
            raise LoweringFailed
        return found

    def _evaluated(self, name: str, entry: Constant) -> NamedArray:
        found = evaluate(self._context, entry.value)
        unit = entry.unit.value if entry.unit else found.unit
        if not entry.dims:
            # a value may have one unnamed axis (R3); two could not be distinguished
            if len([axis for axis in found.axes if not axis.name]) > 1:
                repair = dims_repair(self._context, found.values.shape)
                problem = "is a matrix and needs `dims:`"
                self._context.findings.report(
                    names.unfit_constant(f"`{name}`", problem, entry.value.span, repair)
                )
                raise LoweringFailed
            refuse_infinite(self._context, f"`{name}`", found.values, entry.value.span)
            return NamedArray(found.values, found.axes, unit)
        axes = tuple(self._context.dimension(dim.value, dim.span) for dim in entry.dims)
        return NamedArray(
            shaped(self._context, name, found.values, axes, entry.value.span), axes, unit
        )


def inlined(
    context: Context, name: str, function: Function, call: Call, environment: Environment
) -> NodeId:
    """The node of a call of a function of the spec: its formula with the arguments of the call.
    Reports wrong arguments or a recursive function and raises LoweringFailed.
    """
    expressions = _arguments(context, name, function, call)
    # inlining a recursive function would not terminate
    if name in environment.functions:
        context.findings.report(names.recursive_function(name, call.function.span))
        raise LoweringFailed
    arguments = {key: FunctionArgument(value, environment) for key, value in expressions.items()}
    value = lower(context, function.expr, environment.inside(name, arguments))
    if environment.is_written:
        context.unread.extend(argument for argument in arguments.values() if not argument.lowered)
    return value


def argument_value(
    context: Context, argument: FunctionArgument, environment: Environment
) -> NodeId:
    """The node of an argument of a function of the spec, at the time at which the formula uses it.
    Its names have the meaning that they have at the call. Raises LoweringFailed after reporting a
    mistake.
    """
    # the time suffices as key: part, stage and outer arguments are those of the call
    known = argument.lowered.get(environment.time)
    if known is None:
        there = argument.environment.at_time_of(environment)
        known = argument.lowered[environment.time] = lower(context, argument.expression, there)
    return known


def _arguments(
    context: Context, name: str, function: Function, call: Call
) -> dict[str, Expression]:
    """The expression of each argument of a call, by the parameter names of the function. Arguments
    may be positional or keywords. Reports missing, unknown or surplus ones and raises
    LoweringFailed.
    """
    parameters = tuple(argument.value for argument in function.args)
    arguments: dict[str, Expression] = dict(zip(parameters, call.arguments, strict=False))
    for keyword in call.keywords:
        if keyword.name not in parameters or keyword.name in arguments:
            context.findings.report(
                names.unknown_keyword(name, keyword.name, keyword.span, parameters)
            )
            raise LoweringFailed
        arguments[keyword.name] = keyword.value
    found = len(call.arguments) + len(call.keywords)
    if found != len(parameters):
        plural = "s" if len(parameters) != 1 else ""
        expected = f"{len(parameters)} argument{plural} ({', '.join(parameters)})"
        context.findings.report(names.wrong_argument_count(name, expected, found, call.span))
        raise LoweringFailed
    return arguments


def fitted_to_input(
    context: Context,
    builder: GraphBuilder,
    node: NodeId,
    name: str,
    entry: Connected,
    environment: Environment,
) -> NodeId:
    """The value `node` of a connection, with exactly the axes of the input `name`, and its unit; it
    is repeated along missing axes.

    Other axes are reported and raise LoweringFailed; another unit is reported. Both diagnostics
    show the connection and the declaration of the input, which are in two files.
    """
    signal = entry.feeds
    declaration = signal.place.key
    target = context.axes_of(signal)
    found = builder.type(node)
    is_window = environment.window is not None
    window = tuple(axis for axis in found.axes if axis.name == WINDOW and is_window)
    if not set(found.axes) <= {*target, *window}:
        expected, actual = describe_axes(target), describe_axes(found.axes)
        place = entry.expr.span
        context.findings.report(errors.connection_axes(name, expected, actual, place, declaration))
        raise LoweringFailed
    if signal.unit is not None:
        unit = signal.unit.value
        if found.unit is None:
            builder.set_unit(node, unit)
        elif not same_unit(found.unit, unit):
            place = entry.expr.span
            context.findings.report(
                errors.connection_unit(name, unit.text, found.unit.text, place, declaration)
            )
    return builder.broadcast(node, (*target, *window))
