"""Integrates the continuous states of a model over one sample, all of them together (R6)."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from typing import assert_never

from compiler.ir.builder import GraphBuilder
from compiler.ir.ops import Add
from compiler.ir.program import NodeId
from compiler.ir.rules.unit_rules import addition_unit, product_unit
from compiler.ir.types import Type
from compiler.lowering.context import Context
from compiler.lowering.environment import STEP, Environment, EnvironmentPart, IntegratorStage
from compiler.lowering.expressions import lower
from compiler.lowering.failure import LoweringFailed
from compiler.lowering.places.fitted import fitted
from compiler.lowering.scope import owner_of
from compiler.lowering.unit_conflicts import report_unit_conflicts
from spec_schema.diagnostics.source import Span
from spec_schema.errors import calculus, time, units
from spec_schema.expressions.tree import Expression
from spec_schema.fields.located import Located
from spec_schema.late_dataclass import dataclass
from spec_schema.sections.integrators import (
    Euler,
    Integrator,
    LinearImplicit,
    Method,
    Midpoint,
    RungeKutta4,
    SemiImplicit,
)
from spec_schema.units.parser import parse_unit
from spec_schema.units.per_time import counted_time
from spec_schema.units.unit import Unit

_SECOND = parse_unit("s")

Values = dict[str, NodeId]

LARGEST_SYSTEM = 16
"""Numbers in all continuous states that `linear_implicit` solves for: n³/3 operations a step."""


@dataclass(frozen=True)
class RightHandSide:
    """The right-hand side of one continuous state and the state's type."""

    expression: Expression
    type: Type


def integrated(context: Context, owner: str, integrator: Integrator | None) -> Mapping[str, NodeId]:
    """The values of the continuous states of one spec after one sample time, by its integrator.

    `owner` is the sub-model that has the spec, "" for the model itself.
    """
    vector_field = {
        name: RightHandSide(entry.der, context.type_of(entry))
        for name, entry in context.spec.states.items()
        if entry.der is not None and owner_of(name) == owner
    }
    dt = context.sampling.sample_time
    if dt is None:
        first = next(iter(vector_field.values())).expression
        context.findings.report(time.needs_sample_time("`der:`", first.span))
        raise LoweringFailed
    builder = context.builder(STEP)
    values = {name: builder.state(name, law.type) for name, law in vector_field.items()}
    method = integrator.choice if integrator else None
    if integrator is not None and isinstance(method, LinearImplicit) and method.of is None:
        _check_size(context, vector_field, integrator.place.key)
    substeps = method.substeps if method else 1
    for number in range(1, substeps + 1):
        # as fractions: n of them end at exactly 1, where sums of dt/n may miss it
        begin, end = Fraction(number - 1, substeps), Fraction(number, substeps)
        steps = _Steps(
            context=context,
            owner=owner,
            vector_field=vector_field,
            step_length=dt / substeps,
            begin=begin,
            end=end,
        )
        values = steps.step(method, values)
        if number < substeps:
            steps.name(values, str(number))
    return values


def _check_size(context: Context, vector_field: Mapping[str, RightHandSide], place: Span) -> None:
    size = sum(law.type.size for law in vector_field.values())
    if size > LARGEST_SYSTEM:
        context.findings.report(calculus.too_large_to_solve(size, LARGEST_SYSTEM, place))
        raise LoweringFailed


@dataclass(frozen=True, kw_only=True)
class _Steps:
    """One step of length `step`, h in the formulas, of x' = f(x, τ), by each of the methods.

    τ is the part of the sample time that is over: inputs may move with it.
    """

    context: Context
    owner: str
    vector_field: Mapping[str, RightHandSide]
    step_length: float
    begin: Fraction
    """τ at the beginning of the step."""
    end: Fraction

    def step(self, method: Method | None, values: Values) -> Values:
        match method:
            case Euler():
                return self._moved(values, self._slopes(values, self.begin), self.step_length)
            case SemiImplicit():
                return self._semi_implicit(values)
            case LinearImplicit(of=None):
                return self._linear_implicit(values)
            case LinearImplicit(of=of):
                assert of is not None
                return self._implicit_in(of, values)
            case Midpoint():
                k1 = self._slopes(values, self.begin)
                half = self._point("k2", values, k1, self.step_length / 2)
                return self._moved(values, self._slopes(half, self._middle), self.step_length)
            case RungeKutta4() | None:  # the default without `integrator:`
                return self._runge_kutta(values)
            case _:
                assert_never(method)

    def name(self, values: Values, suffix: str) -> None:
        """Names values inside the step, as generated code shall call them: `x_1`, `x_for_k2`.

        A name that the spec has, or that is one of the spec's as an identifier, gives way.
        """
        builder = self.context.builder(STEP)
        of_spec = {name.replace(".", "_") for name in self.context.scope}
        for name, node in values.items():
            label = f"{name}_{suffix}"
            while label.replace(".", "_") in of_spec:
                label += "_inside"
            builder.name(node, label)

    def _semi_implicit(self, values: Values) -> Values:
        """xᵢ + h fᵢ(x₁⁺ … xᵢ₋₁⁺, xᵢ … xₙ, τ), in the order of `states:`; order 1.

        With a position and a velocity this is the symplectic Euler method, whichever comes first
        (Hairer, Lubich, Wanner: Geometric Numerical Integration, 2006, I.1.2, equation 1.9).
        """
        moved = dict(values)
        for name in values:
            # the slopes of later states see the values that earlier ones have already
            slope = self._slope(name, self._stage(dict(moved), self.begin))
            moved |= self._moved({name: moved[name]}, {name: slope}, self.step_length)
        return moved

    def _linear_implicit(self, values: Values) -> Values:
        """x + Δ with (I − h J) Δ = h f(x, τ), J = ∂f/∂x at x and τ, the end; order 1, L-stable.

        The linearly implicit Euler method (Hairer, Wanner: Solving Ordinary Differential Equations
        II, 1996, IV.7, s = 1 and γ = 1). What moves with time counts at the end of the step, as in
        the implicit Euler method: (7.4a) adds h² ∂f/∂t there, and a stiff state follows its input.
        """
        from compiler.elaboration.integrators.linear_implicit import (
            increments,  # most methods are explicit
        )

        builder = self.context.builder(STEP)
        slopes = self._slopes(values, self.end)
        moved: Values = {}
        for name, increment in increments(builder, values, slopes, self.step_length).items():
            moved[name] = self._sum(builder, name, values[name], increment)
            self._check_rate(builder, name, slopes[name])
        return moved

    def _implicit_in(self, of: Located[str], values: Values) -> Values:
        """The state that feels the equation, implicit in it, first; then the others, as
        semi-implicit Euler does, at its new value: a position moves with the new velocity.
        """
        # most methods are explicit
        from compiler.elaboration.integrators.felt_state import felt_state
        from compiler.elaboration.integrators.implicit_part import ImplicitPart

        builder = self.context.builder(STEP)
        # how the equation varies with one state alone: after a substep others depend on it
        apart = {name: builder.named(node, name) for name, node in values.items()}
        stage = self._stage(apart, self.end)
        name, equation = felt_state(
            self.context, self.owner, of, apart, stage, lambda state: self._slope(state, stage)
        )
        slope = self._slope(name, stage)
        part = ImplicitPart(builder, apart[name], slope, equation)
        expression = self.vector_field[name].expression
        with builder.at(expression.span):
            increment = part.increment(self.step_length, self.context.solved_calls)
            moved = dict(values) | {name: self._sum(builder, name, values[name], increment)}
        builder.conflicts.clear()  # of derivatives, whose units nobody has written
        self._check_rate(builder, name, slope)
        for other in values:
            if other != name:
                slope = self._slope(other, self._stage(dict(moved), self.end))
                moved |= self._moved({other: moved[other]}, {other: slope}, self.step_length)
        return moved

    def _runge_kutta(self, values: Values) -> Values:
        """x + h/6 · (k₁ + 2(k₂ + k₃) + k₄), the classical method (Kutta 1901)."""
        builder = self.context.builder(STEP)
        h = self.step_length
        k1 = self._slopes(values, self.begin)
        k2 = self._slopes(self._point("k2", values, k1, h / 2), self._middle)
        k3 = self._slopes(self._point("k3", values, k2, h / 2), self._middle)
        k4 = self._slopes(self._point("k4", values, k3, h), self.end)
        two = builder.constant(2.0)
        total: Values = {}
        for name in values:
            # in this order for every export: another grouping rounds otherwise
            middle = builder.multiply(two, builder.add(k2[name], k3[name]))
            total[name] = builder.add(builder.add(k1[name], middle), k4[name])
        return self._moved(values, total, h / 6)

    def _point(self, slope: str, values: Values, slopes: Values, length: float) -> Values:
        """values + length · slopes: where the next slope is evaluated."""
        moved = self._moved(values, slopes, length)
        self.name(moved, f"for_{slope}")
        return moved

    @property
    def _middle(self) -> Fraction:
        return (self.begin + self.end) / 2

    def _stage(self, values: Values, fraction: Fraction) -> Environment:
        """Evaluates right-hand sides at these values of the states, at that time."""
        stage = IntegratorStage(values, fraction, self.owner)
        return Environment(EnvironmentPart.STEP, stage=stage)

    def _slopes(self, values: Values, fraction: Fraction) -> Values:
        """f(x, τ), every memoryless equation between states and `der` evaluated anew."""
        stage = self._stage(values, fraction)
        slopes: Values = {}
        # every right-hand side, so that a mistake in one does not hide those in others
        failed = False
        for name in self.vector_field:
            try:
                slopes[name] = self._slope(name, stage)
            except LoweringFailed:
                failed = True
        if failed:
            raise LoweringFailed
        return slopes

    def _slope(self, name: str, stage: Environment) -> NodeId:
        law = self.vector_field[name]
        node = lower(self.context, law.expression, stage)
        self._check_time(name, self.context.builder(stage).type(node).unit)
        # its unit counts where it is multiplied by seconds and added to the state, in `_moved`
        type = law.type.with_unit(None)
        return fitted(self.context, f"`der` of `{name}`", node, type, law.expression, stage)

    def _check_rate(self, builder: GraphBuilder, name: str, slope: NodeId) -> None:
        """Reports a rate that does not fit its state, where the increment has no unit."""
        change = product_unit(builder.type(slope).unit, _SECOND)
        _, conflict = addition_unit(self.vector_field[name].type.unit, change)
        if conflict is not None:
            builder.conflicts.append(conflict)
        report_unit_conflicts(self.context, builder, self.vector_field[name].expression)

    def _check_time(self, name: str, rate: Unit | None) -> None:
        """A state with a unit is checked by its sum; one without takes any rate per second."""
        law = self.vector_field[name]
        if law.type.unit is not None or rate is None or (counted := counted_time(rate)) is None:
            return
        place = self.context.spec.states[name].place.key
        found = units.rate_of_another_time(name, rate.text, *counted, law.expression.span, place)
        self.context.findings.report(found)

    def _moved(self, values: Values, slopes: Values, length: float) -> Values:
        """values + length · slopes."""
        builder = self.context.builder(STEP)
        moved: Values = {}
        for name, value in values.items():
            expression = self.vector_field[name].expression
            with builder.at(expression.span):
                scaled = builder.multiply(builder.constant(length, unit=_SECOND), slopes[name])
                moved[name] = self._sum(builder, name, value, scaled)
            report_unit_conflicts(self.context, builder, expression)
        return moved

    def _sum(self, builder: GraphBuilder, name: str, value: NodeId, change: NodeId) -> NodeId:
        """value + change; a state without a unit has none inside a step either.

        A sum with one unknown unit would take the other, here that of `der` times seconds, and the
        next stage would be told of a mismatch with what the spec says of nothing.
        """
        if self.vector_field[name].type.unit is not None:
            return builder.add(value, change)
        value, change, axes = builder.aligned(value, change)
        return builder.emit(Add(), (value, change), Type(axes, None))
