"""Gives every name of a spec its nodes, each entry lowered once for each way it is used."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from compiler.builtins.table import lower_builtin, lower_plugin_function
from compiler.elaboration.named_values.constants import Constants
from compiler.elaboration.named_values.entries import Entries
from compiler.elaboration.named_values.found_before import FoundBefore
from compiler.elaboration.named_values.functions import argument_value, inlined
from compiler.elaboration.named_values.histories import Histories
from compiler.elaboration.named_values.layer_calls import lower_layer, member_of_layer
from compiler.elaboration.named_values.states import States
from compiler.elaboration.named_values.unknown_names import (
    unknown_function,
    unknown_method,
    unknown_value,
)
from compiler.elaboration.part_members import members_of
from compiler.ir.program import NodeId
from compiler.ir.scalars.signatures import SIGNATURES
from compiler.ir.types import WINDOW, Axis, Type
from compiler.layers.rules.layer_context import LayerStores
from compiler.linking.connected import Connected
from compiler.linking.given_weights import GivenWeights
from compiler.linking.link import Linked, LinkedPart
from compiler.lowering.arrays.arrays import Arrays
from compiler.lowering.context import Context
from compiler.lowering.environment import Environment, EnvironmentPart, Time
from compiler.lowering.failure import LoweringFailed
from compiler.lowering.moving_input import moving_input
from compiler.lowering.sampling import Sampling
from compiler.lowering.scope import Declaration, Kind, Scope
from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.diagnostics.source import Span
from spec_schema.errors import names, submodels
from spec_schema.expressions.language import LOSS_FUNCTIONS, NUMBERS, STATE_FUNCTIONS
from spec_schema.expressions.tree import Call, LanguageName, Member, Name
from spec_schema.plugins import look_up
from spec_schema.registry import FUNCTIONS
from spec_schema.sections.dimensions import Dimension
from spec_schema.sections.layers.layer import Layer
from spec_schema.sections.signals import Equation, Input, Output, Signal, State
from spec_schema.sections.submodels import Use
from spec_schema.sections.values import Constant, Function, Parameter
from spec_schema.units.parser import parse_unit

_SECOND = parse_unit("s")


class Elaboration:
    """The meaning of every name of one spec (`Names`), and all that lowering it leaves."""

    def __init__(
        self, linked: Linked, variables: frozenset[str], known: FoundBefore, draw: int = 0
    ) -> None:
        """`variables` are those of gradients; `known` was found by the lowering before this one."""
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
        """Another one of the same spec, with graphs of its own: for what may fail half-way."""
        return Elaboration(self._linked, self._variables, known, self._draw)

    def found(self) -> FoundBefore:
        """The findings of this lowering for the next one."""
        return FoundBefore(self.histories.found(), self.layers.found_units())

    # ---- names

    def value(self, name: Name, environment: Environment) -> NodeId:
        """The node of a bare name."""
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
        """The declaration of a name, of which a `member` is wanted; reports an unknown one."""
        found = self.context.scope.get(name)
        if found is None:
            self.context.findings.report(unknown_value(self.context, name, span, member))
            raise LoweringFailed
        self.context.used.add(name)
        return found

    def member(self, member: Member, environment: Environment) -> NodeId:
        """`s.meas`: the log of a signal or state, whatever the step sees (R6); `phi.centers`."""
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
        """The value of a layer, function or builtin."""
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
        """The right-hand side of a continuous state."""
        return self.states.derivative(name, entry, span, environment)

    def lowerings(self, name: str, environment: Environment) -> Sequence[tuple[Time, NodeId]]:
        """Every time at which an entry is lowered already, and its node there."""
        return self.entries.lowerings(name, environment)

    def tried(self, lower_it: Callable[[], NodeId]) -> NodeId | None:
        """The node, or None where lowering fails; nothing is reported and nothing remembered."""
        return self.entries.tried(lower_it)

    # ---- inside

    def _part_of(self, member: Member) -> LinkedPart[object] | None:
        """The part, such as a robot, that a member or what stands before its dot belongs to."""
        # `arm.tip.position`: its base is the frame `arm.tip` of the robot `arm`
        for name in (member.base, member.base.rpartition(".")[0]):
            part = self._linked.parts.get(name)
            if part is not None and member.base not in self.context.spec.dims:
                return part
        return None

    def _at_a_stage(self, name: str, entry: Signal, environment: Environment) -> NodeId | None:
        """An input that moves while a right-hand side is evaluated; None where it does not."""
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
        """The samples of a signal at the environment's time: its log, or what the step sees."""
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
