"""Lowers states: their value, the result of the integrator, the value after the step (R4, R6)."""

from __future__ import annotations

from collections.abc import Mapping

from compiler.elaboration.integrators.integration import integrated
from compiler.elaboration.named_values.histories import Histories
from compiler.ir.builder import GraphBuilder
from compiler.ir.program import NodeId
from compiler.lowering.context import Context
from compiler.lowering.environment import START, STEP, Environment, EnvironmentPart
from compiler.lowering.expressions import lower
from compiler.lowering.failure import LoweringFailed
from compiler.lowering.places.fitted import fitted
from compiler.lowering.ranges import range_in
from compiler.lowering.scope import owner_of
from compiler.passes.analyses.saturation import saturated
from spec_schema.diagnostics.source import Span
from spec_schema.errors import names
from spec_schema.errors import states as errors
from spec_schema.expressions.tree import Call, Name
from spec_schema.sections.integrators import Integrator
from spec_schema.sections.signals import State


class States:
    """The declared states of a context."""

    def __init__(
        self,
        context: Context,
        histories: Histories,
        integrators: Mapping[str, Integrator | None],
    ) -> None:
        self._context = context
        self._histories = histories
        self._integrators = integrators
        self._flow: dict[str, Mapping[str, NodeId]] = {}
        self._next: dict[str, NodeId | None] = {}
        """None for a state whose `next` failed or is being lowered."""
        self._followed: list[str] = []
        """States whose `next` is being lowered, outermost first."""
        self._differentiated: list[str] = []
        """States whose right-hand side is being lowered, outermost first."""

    def value(self, name: str, entry: State, span: Span, environment: Environment) -> NodeId:
        """The value of a state for an expression: now, or at a stage of the integrator."""
        findings = self._context.findings
        if environment.part is EnvironmentPart.CONSTANT:
            findings.report(names.constant_needed(f"`{name}`", span))
            raise LoweringFailed
        if environment.part is EnvironmentPart.START:
            if environment.latest < 0:
                return self._histories.before(name, entry, span, environment)
            findings.report(errors.simulation_in_init(name, span))
            raise LoweringFailed
        if environment.is_elsewhere:
            return self._histories.read(name, entry, span, environment)
        if environment.stage is not None and name in environment.stage.values:
            return environment.stage.values[name]
        # discrete, or of another spec: constant over the step of this integrator (R6)
        return self._context.builder(environment).state(name, self._context.type_of(entry))

    def call(self, function: str, call: Call, environment: Environment) -> NodeId:
        """`next(x)` or `flow(x)` of a state."""
        findings = self._context.findings
        if len(call.arguments) != 1 or call.keywords:
            found = len(call.arguments) + len(call.keywords)
            findings.report(
                names.wrong_argument_count(function, "1 argument", found, call.function.span)
            )
            raise LoweringFailed
        argument = call.arguments[0]
        name = argument.name if isinstance(argument, Name) else ""
        entry = self._context.spec.states.get(name)
        if entry is None:
            findings.report(errors.not_a_state(function, argument.span))
            raise LoweringFailed
        if (
            environment.part in (EnvironmentPart.START, EnvironmentPart.CONSTANT)
            or environment.stage is not None
        ):
            where = "a vector field" if environment.stage else environment.part.value
            findings.report(names.misplaced(function, where, call.span))
            raise LoweringFailed
        if function == "next":
            if name in self._followed:
                loop = (*self._followed[self._followed.index(name) :], name)
                findings.report(
                    errors.algebraic_loop(tuple(f"next({state})" for state in loop), call.span)
                )
                raise LoweringFailed
            return self.next(name, entry)
        if entry.der is None:
            findings.report(errors.flow_of_discrete(name, argument.span))
            raise LoweringFailed
        return self.flow(owner_of(name))[name]

    def derivative(self, name: str, entry: State, span: Span, environment: Environment) -> NodeId:
        """The right-hand side of a continuous state at the environment's time and stage."""
        assert entry.der is not None
        before = environment.part is EnvironmentPart.START and environment.latest < 0
        if environment.part in (EnvironmentPart.START, EnvironmentPart.CONSTANT) and not before:
            where = environment.part.value
            repair = f"write `der({name}.meas)` for the derivative of its log"
            self._context.findings.report(names.misplaced("der", where, span, repair))
            raise LoweringFailed
        if name in self._differentiated:
            loop = (*self._differentiated[self._differentiated.index(name) :], name)
            self._context.findings.report(
                errors.algebraic_loop(tuple(f"der({state})" for state in loop), span)
            )
            raise LoweringFailed
        self._differentiated.append(name)
        try:
            return lower(self._context, entry.der, environment.of_entry())
        finally:
            self._differentiated.pop()

    def next(self, name: str, entry: State) -> NodeId:
        """The value of a state after the step: its `next:`, otherwise the result of the
        integrator.
        """
        if name not in self._next:
            self._next[name] = None
            self._followed.append(name)
            try:
                self._next[name] = self._lower_next(name, entry)
            finally:
                self._followed.pop()
        node = self._next[name]
        if node is None:
            raise LoweringFailed
        return node

    def start(self, name: str, entry: State, builder: GraphBuilder) -> NodeId:
        """The value before the first step, from `init:`; 0 without it."""
        type = self._context.type_of(entry)
        if entry.start is None:
            return builder.broadcast(builder.constant(0.0, unit=type.unit), type.axes)
        at_start = START
        node = lower(self._context, entry.start, at_start)
        return fitted(self._context, f"`init` of `{name}`", node, type, entry.start, at_start)

    def flow(self, owner: str) -> Mapping[str, NodeId]:
        """The result of the integrator for all continuous states of one spec (R6)."""
        if owner not in self._flow:
            self._flow[owner] = integrated(self._context, owner, self._integrators[owner])
        return self._flow[owner]

    # ---- inside

    def _lower_next(self, name: str, entry: State) -> NodeId:
        following = self._lower_law(name, entry)
        type = self._context.type_of(entry)
        limits = range_in(self._context, entry.range, type.unit)
        # saturation is part of `next`, so that training differentiates it; a reset exists in
        # deployed code only
        if entry.on_range is None or entry.on_range.value != "saturate" or limits is None:
            return following
        builder = self._context.builder(STEP)
        with builder.at(entry.on_range.span):
            return saturated(builder, following, builder.state(name, type), limits)

    def _lower_law(self, name: str, entry: State) -> NodeId:
        if entry.next is None:
            return self.flow(owner_of(name))[name]
        node = lower(self._context, entry.next, STEP)
        what = f"`next` of `{name}`"
        return fitted(self._context, what, node, self._context.type_of(entry), entry.next, STEP)
