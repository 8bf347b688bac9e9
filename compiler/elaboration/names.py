"""Looks up every name and call of a spec and returns its node; lowers each entry once for each time
at which it is read.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Generic, TypeAlias, TypeVar

from compiler import layers
from compiler.builtins.table import lower_builtin, lower_plugin_function
from compiler.elaboration.entries import Constants, Entries, argument_value, inlined
from compiler.elaboration.states import FoundBefore, Histories, States
from compiler.ir.program import NodeId
from compiler.ir.scalars import SIGNATURES
from compiler.ir.types import WINDOW, Axis, Type
from compiler.layers.rules.layer_rule import AnyRule, LayerContext, LayerStores
from compiler.linking.link import Connected, GivenWeights, Linked, LinkedPart
from compiler.lowering.arrays import Arrays
from compiler.lowering.context import Context, Declaration, Kind, LoweringFailed, Sampling, Scope
from compiler.lowering.environment import Environment, EnvironmentPart, Time
from compiler.lowering.expressions import moving_input
from spec_schema.diagnostics.diagnostic import Diagnostic, Findings
from spec_schema.diagnostics.source import Span
from spec_schema.errors import names, submodels
from spec_schema.expressions.language import (
    ELSEWHERE,
    LOSS_FUNCTIONS,
    NUMBERS,
    STATE_FUNCTIONS,
    formula_for,
    written_here,
)
from spec_schema.expressions.tree import Call, LanguageName, Member, Name
from spec_schema.fields.entry import Entry
from spec_schema.late_dataclass import dataclass
from spec_schema.plugins import look_up
from spec_schema.registry import FUNCTIONS, PartLine
from spec_schema.sections.layers import Layer
from spec_schema.sections.signals import Equation, Input, Output, Signal, State
from spec_schema.sections.submodels import Use
from spec_schema.sections.values import Constant, Dimension, Function, Parameter
from spec_schema.units.parser import parse_unit

_SECOND = parse_unit("s")


class Elaboration:
    """One lowering of a spec. It implements the protocol `Names`: it returns the nodes of names and
    calls, and collects nodes, states and findings.
    """

    def __init__(
        self, linked: Linked, variables: frozenset[str], known: FoundBefore, draw: int = 0
    ) -> None:
        """`variables` are the names by which some `grad` differentiates; `known` are results of the
        previous lowering, `draw` selects random initial values of the spec `linked`.
        """
        self._linked, self._variables, self._draw = linked, variables, draw
        findings = Findings()
        spec = linked.spec
        seconds = spec.sample_time.value if spec.sample_time else None
        self.context = Context(
            spec=spec,
            findings=findings,
            scope=Scope(spec, findings),
            sampling=Sampling(seconds, findings),
            given=GivenWeights(linked, findings),
            names=self,
            draw=draw,
            numbers=linked.numbers,
        )
        self.constants = Constants(self.context)
        self.arrays = Arrays(self.context)
        self.layers = LayerStores(self.arrays, known_units=known.units)
        self.histories = Histories(self.context, known.buffers)
        self.states = States(self.context, self.histories, linked.integrators)
        self.entries = Entries(self.context, self.histories, variables)

    def afresh(self, known: FoundBefore) -> Elaboration:
        """A new lowering of the same spec with empty graphs and findings, for attempts that may
        fail. It assumes the buffers and units `known`.
        """
        return Elaboration(self._linked, self._variables, known, self._draw)

    def found(self) -> FoundBefore:
        """The buffer lengths and units that this lowering needs; the next lowering assumes them."""
        return FoundBefore(self.histories.found(), self.layers.found_units())

    # ---- names

    def value(self, name: Name, environment: Environment) -> NodeId:
        """The node of a name such as `mass` in an environment. Raises LoweringFailed after
        reporting a mistake.
        """
        # arguments of a function come first: they hide entries of the spec
        argument = environment.arguments.get(name.name)
        if argument is not None:
            return argument_value(self.context, argument, environment)
        builder = self.context.builder(environment)
        if name.name in NUMBERS:
            return builder.constant(NUMBERS[name.name])
        if name.name == "dt":
            return builder.constant(self.context.sampling.required("`dt`", name.span), unit=_SECOND)
        declared = self.declared(name.name, name.span)
        match declared.entry:
            case Signal() as signal:
                # an input that is given between its samples moves while the integrator looks at it
                # (decision 0208)
                moving = self._at_a_stage(name.name, signal, environment)
                if moving is not None:
                    return moving
                logged = (
                    # only the step sees what is simulated; losses and starts read the log (R6)
                    declared.kind is Kind.TARGET or environment.part is not EnvironmentPart.STEP
                )
                return self._signal(name.name, signal, name.span, environment, logged=logged)
            case Constant() as constant:
                array = self.constants.value(name.name, constant)
                return builder.constant(array.values, array.axes, array.unit, name.name)
            case Parameter() as parameter:
                self._forbid_in_constant(name.name, name.span, environment)
                self.arrays.parameter(name.name, parameter)
                if environment.stage is not None:
                    self.context.stage_reads.parameters.add((environment.stage.owner, name.name))
                return self.arrays.read(builder, name.name)
            case State() as state:
                return self.states.value(name.name, state, name.span, environment)
            case Equation() | Output() as entry:
                return self.entries.value(name.name, entry, environment, name.span)
            case Layer() | Function() | Dimension() | Use():
                self.context.findings.report(
                    names.not_a_value(name.name, declared.kind.value, name.span)
                )
                raise LoweringFailed

    def declared(self, name: str, span: Span, member: str = "") -> Declaration:
        """The declaration of a name, which counts as used from then on.

        `member` is the name after a dot, if there is one, for the message. Reports an unknown name
        and raises LoweringFailed.
        """
        found = self.context.scope.get(name)
        if found is None:
            self.context.findings.report(unknown_value(self.context, name, span, member))
            raise LoweringFailed
        self.context.used.add(name)
        return found

    def member(self, member: Member, environment: Environment) -> NodeId:
        """The node of `base.member`: `s.meas` is the log of a signal or state, even if the step
        simulates it (R6); `phi.centers` is a value of a layer. Raises LoweringFailed after
        reporting a mistake.
        """
        # names of members of sub-models have dots: the last one need not be that before `meas`
        base, _, rest = member.base.rpartition(".")
        if member.base not in self.context.scope and base in self.context.scope:  # `x.meas.meas`
            member = Member(base, f"{rest}.{member.name}", member.span)
        part = self._part_of(member)
        if part is not None:
            self.context.findings.report(members_of(part.line).unknown(part, member))
            raise LoweringFailed
        entry = self.declared(member.base, member.span, member.name).entry
        if isinstance(entry, Use):
            unknown = f"{member.base}.{member.name}"
            self.context.findings.report(
                submodels.unknown_submodel_member(unknown, member.span, self.context.scope)
            )
            raise LoweringFailed
        if isinstance(entry, Connected) and member.name == "meas":
            if environment.part is EnvironmentPart.START:  # where a bare input is its log too
                return self.entries.value(member.base, entry, environment, member.span)
            place = entry.place.key
            self.context.findings.report(
                submodels.log_of_connected(member.base, member.span, place)
            )
            raise LoweringFailed
        if isinstance(entry, Layer):
            self._forbid_in_constant(member.base, member.span, environment)
            return member_of_layer(self.context, self.layers, member, entry, environment)
        if member.name != "meas" or not isinstance(entry, Signal | State):
            self.context.findings.report(names.no_member(member.base, member.name, member.span))
            raise LoweringFailed
        if isinstance(entry, State):
            # whose log is read must be in the data (R6)
            self.context.measured.setdefault(member.base, entry)
        return self._signal(member.base, entry, member.span, environment, logged=True)

    # ---- calls

    def call(self, call: Call, environment: Environment) -> NodeId:
        """The node of a call of a layer, a function of the spec or of a plug-in, or a builtin.
        Raises LoweringFailed after reporting a mistake.
        """
        function = call.function
        if isinstance(function, Member):
            part = self._part_of(function)
            if part is not None:
                self._forbid_in_constant(part.name, function.span, environment)
                return members_of(part.line).call(self.context, part, call, environment)
            owner = self.context.scope.get(function.base)
            if owner is not None and isinstance(owner.entry, Layer):
                self.context.used.add(function.base)
                self._forbid_in_constant(function.base, function.span, environment)
                return lower_layer(
                    self.context, self.layers, function.base, owner.entry, call, environment
                )
            self.context.findings.report(unknown_method(self.context, function))
            raise LoweringFailed
        name = function.name
        if name in environment.arguments:
            self.context.findings.report(names.not_callable(name, "an argument", function.span))
            raise LoweringFailed
        if name in STATE_FUNCTIONS:
            return self.states.call(name, call, environment)
        is_declared = name in self.context.scope and not isinstance(function, LanguageName)
        if name in SIGNATURES and not is_declared:
            return lower_builtin(self.context, name, call, environment)
        if name in LOSS_FUNCTIONS and not is_declared:
            repair = "it belongs in `losses:`"
            self.context.findings.report(
                names.misplaced(name, "an expression", function.span, repair)
            )
            raise LoweringFailed
        declared = self.declared(name, function.span) if is_declared else None
        if declared is None:
            # in a sub-model the names that msnn does not have are full ones
            own = name.rpartition(".")[2]
            if own not in FUNCTIONS:
                self.context.findings.report(*look_up().warnings)
            if own in FUNCTIONS:
                return lower_plugin_function(self.context, FUNCTIONS[own], call, environment)
            self.context.findings.report(unknown_function(self.context, function, environment))
            raise LoweringFailed
        match declared.entry:
            case Layer() as layer:
                self._forbid_in_constant(name, function.span, environment)
                return lower_layer(self.context, self.layers, name, layer, call, environment)
            case Function() as entry:
                return inlined(self.context, name, entry, call, environment)
            case _:
                moves = isinstance(declared.entry, Signal | State | Equation)
                self.context.findings.report(
                    names.not_callable(name, declared.kind.value, function.span, moves)
                )
                raise LoweringFailed

    # ---- entries

    def derivative(self, name: str, entry: State, span: Span, environment: Environment) -> NodeId:
        """The node of the time derivative of the continuous state `name`: the right-hand side of
        its differential equation. Raises LoweringFailed after reporting a mistake.
        """
        return self.states.derivative(name, entry, span, environment)

    def lowerings(self, name: str, environment: Environment) -> Sequence[tuple[Time, NodeId]]:
        """The nodes to which the equation or output `name` has been lowered so far, each with its
        time (shift and window).
        """
        return self.entries.lowerings(name, environment)

    def tried(self, lower_it: Callable[[], NodeId]) -> NodeId | None:
        """The node that `lower_it` returns. None if it raises LoweringFailed; then its reports are
        removed, and nothing counts as failed.
        """
        return self.entries.tried(lower_it)

    # ---- inside

    def _part_of(self, member: Member) -> LinkedPart[object] | None:
        """The part, such as a robot, of which `member` is a member, directly or through a name
        within the part (`arm.tip.position`); None if there is none.
        """
        # `arm.tip.position`: its base is the frame `arm.tip` of the robot `arm`
        for name in (member.base, member.base.rpartition(".")[0]):
            part = self._linked.parts.get(name)
            if part is not None and member.base not in self.context.spec.dims:
                return part
        return None

    def _at_a_stage(self, name: str, entry: Signal, environment: Environment) -> NodeId | None:
        """The node of an interpolated input at an integrator stage, between two samples; None if
        the input is constant during the step, or outside of stages.
        """
        stage = environment.stage
        if stage is None or environment.is_elsewhere or not isinstance(entry, Input):
            return None
        # at fraction 0, the sample itself, a held input and a moving one are the same
        if stage.fraction:
            self.context.stage_reads.inputs.add((stage.owner, name))
        return moving_input(self.context, name, entry, environment)

    def _signal(
        self,
        name: str,
        entry: Signal | State,
        span: Span,
        environment: Environment,
        *,
        logged: bool,
    ) -> NodeId:
        """The node of the samples of a signal at the environment's time: the recorded ones if
        `logged`, otherwise those that the step sees. Reports a read in a constant and raises
        LoweringFailed.
        """
        self._forbid_in_constant(name, span, environment)
        axes = self.context.axes_of(entry)
        first, last = environment.window or (0, 0)
        if environment.window is not None:
            axes = (*axes, Axis(WINDOW, last - first + 1))
        type = Type(axes, entry.unit.value if entry.unit else None)
        # the samples of a window are counted from the time that the surroundings are read at
        first, last = first + environment.shift, last + environment.shift
        builder = self.context.builder(environment)
        read = builder.log if logged else builder.signal
        return read(name, first, last, type)

    def _forbid_in_constant(self, name: str, span: Span, environment: Environment) -> None:
        if environment.part is EnvironmentPart.CONSTANT:
            self.context.findings.report(names.constant_needed(f"`{name}`", span))
            raise LoweringFailed


_CALLABLE = (Kind.LAYER, Kind.FUNCTION)


def unknown_value(context: Context, name: str, span: Span, member: str) -> Diagnostic:
    """The diagnostic of an unknown name. `member` is the name after a dot that follows it, ""
    without one.
    """
    if name in SIGNATURES:
        return names.not_a_value(name, "a builtin", span)
    known = (*context.scope, "dt", *NUMBERS)
    repair = written_here(name, member, SIGNATURES) if member else None
    return names.unknown_name(name, span, known, repair=repair, otherwise=formula_for(name))


def unknown_function(context: Context, function: Name, environment: Environment) -> Diagnostic:
    """The diagnostic of a call of an unknown function; it suggests similar names that can be called
    in this environment.
    """
    name = function.name
    callable = [n for n, declared in context.scope.items() if declared.kind in _CALLABLE]
    losses = LOSS_FUNCTIONS if environment.part is EnvironmentPart.LOSS else ()
    return names.unknown_name(
        name,
        function.span,
        (*callable, *SIGNATURES, *losses, *FUNCTIONS),
        "a layer or function",
        ELSEWHERE.get(name),
        otherwise=formula_for(name),
    )


def unknown_method(context: Context, function: Member) -> Diagnostic:
    """The diagnostic of a call of a member that does not exist, such as `np.tanh(…)`."""
    repair = None
    if function.base not in context.scope:
        repair = written_here(function.base, function.name, SIGNATURES)
    return names.no_member(function.base, function.name, function.span, repair)


def lower_layer(
    lowering: Context,
    stores: LayerStores,
    name: str,
    entry: Layer,
    call: Call,
    environment: Environment,
) -> NodeId:
    """The node of a call `NAME(…)` of the layer `name`, or of `NAME.member(…)` if this kind of
    layer has such a member. `stores` is the state that all layers share. Raises LoweringFailed
    after reporting a mistake.
    """
    settings = entry.chosen()
    rule = rule_of(settings)
    expand = rule.expand
    if isinstance(call.function, Member):
        member = rule.members.get(call.function.name)
        if member is None:
            lowering.findings.report(
                names.no_layer_member(
                    name, call.function.name, call.function.span, rule.members, rule.values
                )
            )
            raise LoweringFailed
        expand = member
    context = _context(lowering, stores, name, entry, call, environment)
    arguments = rule.read(context, settings)
    return expand(context.with_arguments(arguments), settings, arguments)


def member_of_layer(
    lowering: Context,
    stores: LayerStores,
    member: Member,
    entry: Layer,
    environment: Environment,
) -> NodeId:
    """The node of `NAME.value` without a call: a value that this kind of layer defines, such as
    `phi.centers`. `stores` is the state that all layers share.

    Losses, which are lowered last, can also read an array of a layer: `NAME.weight`. Reports any
    other name and raises LoweringFailed.
    """
    settings = entry.chosen()
    rule = rule_of(settings)
    if member.name in rule.values:
        call = Call(member, (), (), member.span)
        context = _context(lowering, stores, member.base, entry, call, environment)
        return rule.values[member.name](context, settings)
    arrays = stores.arrays.of_layer(member.base)
    if environment.part is EnvironmentPart.LOSS and member.name in arrays:
        return stores.arrays.read(lowering.builder(environment), f"{member.base}.{member.name}")
    lowering.findings.report(
        names.no_value_of_layer(
            member.base,
            member.name,
            member.span,
            arrays=arrays,
            values=rule.values,
            members=rule.members,
            in_loss=environment.part is EnvironmentPart.LOSS,
        )
    )
    raise LoweringFailed


def _context(
    lowering: Context,
    stores: LayerStores,
    name: str,
    entry: Layer,
    call: Call,
    environment: Environment,
) -> LayerContext:
    return LayerContext(
        name=name,
        lowering=lowering,
        stores=stores,
        call=call,
        environment=environment,
        span=entry.place.key,
        rule_of=rule_of,
    )


def rule_of(settings: Entry) -> AnyRule:
    """The rule of the kind of layer to which these settings belong."""
    return layers.rule_of(type(settings))


M = TypeVar("M")


@dataclass(frozen=True, kw_only=True)
class PartMembers(Generic[M]):
    """The functions for members of parts of one kind, such as robots; `M` is the class of the data
    in the part's file.
    """

    call: Callable[[Context, LinkedPart[M], Call, Environment], NodeId]
    """Returns the node of a call of a member. Raises LoweringFailed after reporting a mistake."""
    unknown: Callable[[LinkedPart[M], Member], Diagnostic]
    """Returns the diagnostic of a member that does not exist or is no value without a call."""


AnyPartMembers: TypeAlias = PartMembers[Any]


def members_of(line: PartLine) -> AnyPartMembers:
    """The functions for members of the kind of parts that `line` of the registry lists; their
    module is imported first.
    """
    members: AnyPartMembers = line.members.value
    return members
