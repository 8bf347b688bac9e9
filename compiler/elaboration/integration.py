"""Integrates the continuous states of one spec together over one sample time (R6)."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from typing import assert_never

from compiler.ir.builder import GraphBuilder
from compiler.ir.ops import Add
from compiler.ir.program import NodeId
from compiler.ir.rules import addition_unit, product_unit
from compiler.ir.types import Type
from compiler.linking.link import Connected
from compiler.lowering.context import Context, LoweringFailed, owner_of
from compiler.lowering.environment import STEP, Environment, EnvironmentPart, IntegratorStage
from compiler.lowering.expressions import lower, report_unit_conflicts
from compiler.lowering.places import fitted
from spec_schema.diagnostics.source import Span
from spec_schema.errors import between, calculus, time, units
from spec_schema.expressions.tree import Expression
from spec_schema.fields.leaf import Located
from spec_schema.late_dataclass import dataclass
from spec_schema.sections.signals import Input
from spec_schema.sections.spec import (
    Euler,
    Integrator,
    LinearImplicit,
    Method,
    Midpoint,
    RungeKutta4,
    SemiImplicit,
)
from spec_schema.units.parser import parse_unit
from spec_schema.units.quantity import counted_time
from spec_schema.units.unit import Unit

_SECOND = parse_unit("s")

Values = dict[str, NodeId]

LARGEST_SYSTEM = 16
"""Maximum number of state elements that `linear_implicit` solves for: n³/3 operations per step."""


@dataclass(frozen=True)
class RightHandSide:
    """The right-hand side of the differential equation of one continuous state, and the type of the
    state.
    """

    expression: Expression
    type: Type


def integrated(context: Context, owner: str, integrator: Integrator | None) -> Mapping[str, NodeId]:
    """The nodes of the continuous states of one spec after one sample time, by name, computed by
    its integrator; None means the default, Runge-Kutta.

    `owner` is the sub-model that has the spec, "" for the model itself. Raises LoweringFailed after
    reporting a mistake.
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
        # fractions are exact: the last substep ends at 1, while sums of dt/n may not
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
    """One step of x' = f(x, τ) of length h = `step_length` in seconds, by each integration method.

    τ is the elapsed fraction of the sample time; inputs may change with it.
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
        """Sets labels of intermediate values of states for generated code, such as `x_1` and
        `x_for_k2`; `suffix` is the part after `x_`.

        If a label collides with a name of the spec, `_inside` is appended.
        """
        builder = self.context.builder(STEP)
        of_spec = {name.replace(".", "_") for name in self.context.scope}
        for name, node in values.items():
            label = f"{name}_{suffix}"
            while label.replace(".", "_") in of_spec:
                label += "_inside"
            builder.name(node, label)

    def _semi_implicit(self, values: Values) -> Values:
        """The states after a semi-implicit Euler step from x = `values`: xᵢ + h fᵢ(x₁⁺ … xᵢ₋₁⁺, xᵢ
        … xₙ, τ), in the order of `states:`, with x⁺ the new values; order 1.

        For a position and a velocity this is the symplectic Euler method, in either order (Hairer,
        Lubich, Wanner: Geometric Numerical Integration, 2006, I.1.2, equation 1.9).
        """
        moved = dict(values)
        for name in values:
            # derivatives of later states use the new values of earlier ones
            slope = self._slope(name, self._stage(dict(moved), self.begin))
            moved |= self._moved({name: moved[name]}, {name: slope}, self.step_length)
        return moved

    def _linear_implicit(self, values: Values) -> Values:
        """The states after a linearly implicit Euler step from x = `values`: x + Δ with (I − h J) Δ
        = h f(x, τ) and J = ∂f/∂x at x and at τ, the end of the step; order 1, L-stable.

        The method is Hairer, Wanner: Solving Ordinary Differential Equations II, 1996, IV.7, with s
        = 1 and γ = 1. Time-dependent terms are evaluated at the end of the step, as in the implicit
        Euler method, so that a stiff state follows its input. (7.4a) adds h² ∂f/∂t instead.
        """
        from compiler.elaboration.implicit_integration import (
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
        """The states after a step that is implicit through the equation `of`: the state whose
        derivative reads the equation first, then the others by semi-implicit Euler.

        The other states use its new value: a position moves with the new velocity. Raises
        LoweringFailed after reporting an unsuitable equation.
        """
        # most methods are explicit
        from compiler.elaboration.implicit_integration import ImplicitPart, felt_state

        builder = self.context.builder(STEP)
        # named copies isolate each state: after a substep the states depend on each other
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
        builder.conflicts.clear()  # units of derivatives are not declared anywhere
        self._check_rate(builder, name, slope)
        for other in values:
            if other != name:
                slope = self._slope(other, self._stage(dict(moved), self.end))
                moved |= self._moved({other: moved[other]}, {other: slope}, self.step_length)
        return moved

    def _runge_kutta(self, values: Values) -> Values:
        """The states after a step of the classical Runge-Kutta method from x = `values`: x + h/6 ·
        (k₁ + 2(k₂ + k₃) + k₄), with the derivatives k₁ … k₄ (Kutta 1901).
        """
        builder = self.context.builder(STEP)
        h = self.step_length
        k1 = self._slopes(values, self.begin)
        k2 = self._slopes(self._point("k2", values, k1, h / 2), self._middle)
        k3 = self._slopes(self._point("k3", values, k2, h / 2), self._middle)
        k4 = self._slopes(self._point("k4", values, k3, h), self.end)
        two = builder.constant(2.0)
        total: Values = {}
        for name in values:
            # every export uses this order: another grouping would round differently
            middle = builder.multiply(two, builder.add(k2[name], k3[name]))
            total[name] = builder.add(builder.add(k1[name], middle), k4[name])
        return self._moved(values, total, h / 6)

    def _point(self, slope: str, values: Values, slopes: Values, length: float) -> Values:
        """The point `values + length · slopes` of all states, at which the derivative called
        `slope` is evaluated, such as k2. Labels it for generated code.
        """
        moved = self._moved(values, slopes, length)
        self.name(moved, f"for_{slope}")
        return moved

    @property
    def _middle(self) -> Fraction:
        return (self.begin + self.end) / 2

    def _stage(self, values: Values, fraction: Fraction) -> Environment:
        """The environment in which right-hand sides are evaluated, with the states `values` and at
        this fraction of the sample time.
        """
        stage = IntegratorStage(values, fraction, self.owner)
        return Environment(EnvironmentPart.STEP, stage=stage)

    def _slopes(self, values: Values, fraction: Fraction) -> Values:
        """The nodes of the derivatives f(x, τ) by state, at x = `values` and τ = `fraction`.

        Equations without memory that a right-hand side reads are evaluated again at each stage.
        Raises LoweringFailed after reporting the mistakes of all right-hand sides.
        """
        stage = self._stage(values, fraction)
        slopes: Values = {}
        # lower all right-hand sides, so that a mistake in one does not hide others
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
        # `_moved` checks its unit, when it is multiplied by seconds and added to the state
        type = law.type.with_unit(None)
        return fitted(self.context, f"`der` of `{name}`", node, type, law.expression, stage)

    def _check_rate(self, builder: GraphBuilder, name: str, slope: NodeId) -> None:
        """Reports that the unit of the derivative `slope`, times seconds, does not fit the unit of
        its state `name`. It is needed where the unit of the increment is unknown.
        """
        change = product_unit(builder.type(slope).unit, _SECOND)
        _, conflict = addition_unit(self.vector_field[name].type.unit, change)
        if conflict is not None:
            builder.conflicts.append(conflict)
        report_unit_conflicts(self.context, builder, self.vector_field[name].expression)

    def _check_time(self, name: str, rate: Unit | None) -> None:
        """Reports a derivative in a unit per another time than seconds, such as per hour, of the
        state `name` if this has no unit. `rate` is the unit of the derivative.

        A state with a unit is checked by its sum instead.
        """
        law = self.vector_field[name]
        if law.type.unit is not None or rate is None or (counted := counted_time(rate)) is None:
            return
        place = self.context.spec.states[name].place.key
        found = units.rate_of_another_time(name, rate.text, *counted, law.expression.span, place)
        self.context.findings.report(found)

    def _moved(self, values: Values, slopes: Values, length: float) -> Values:
        """The nodes of `values + length · slopes`, state by state; `length` is in seconds. Units
        that do not fit are reported.
        """
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
        """The node of value + change for the state `name`; it has no unit if the state has none.

        Otherwise the sum would take the unit of `der` times seconds. The next stage would then
        report a conflict with units that the spec does not declare.
        """
        if self.vector_field[name].type.unit is not None:
            return builder.add(value, change)
        value, change, axes = builder.aligned(value, change)
        return builder.emit(Add(), (value, change), Type(axes, None))


def report_between(context: Context) -> None:
    """Reports mistakes in the option `between` of inputs, which interpolates them between samples,
    after the spec has been lowered.
    """
    _report_closed(context)
    if context.findings.failed:
        return
    later = {name for _, name in context.stage_reads.inputs}
    for name, entry in context.spec.inputs.items():
        # no integrator stage reads it after the sample, so interpolation has no effect
        is_idle = entry.is_linear and name in context.used and name not in later
        if is_idle and not owner_of(name):
            assert entry.between is not None
            context.findings.report(between.nothing_between(name, entry.between.span))
    for name, entry in context.spec.equations.items():
        fed = entry.feeds if isinstance(entry, Connected) else None
        if isinstance(fed, Input) and fed.is_linear:
            assert fed.between is not None
            place = entry.place.key
            context.findings.report(between.held_connection(name, place, fed.between.span))
    if context.spec.train:
        _remark_held(context)


def _report_closed(context: Context) -> None:
    """Reports interpolated inputs that an output predicts: in a closed loop, their value at t+1 is
    not known at t.
    """
    for output, entry in context.spec.outputs.items():
        if entry.predicts is None:
            continue
        signal = entry.predicts.signal
        fed = context.spec.inputs.get(signal.value)
        if fed is not None and fed.is_linear:
            assert fed.between is not None
            place = fed.between.span
            context.findings.report(
                between.closed_between(signal.value, output, place, signal.span)
            )


def _remark_held(context: Context) -> None:
    """Warns about inputs without the option `between` that right-hand sides with learned parameters
    read between samples.
    """
    predicted = {o.predicts.signal.value for o in context.spec.outputs.values() if o.predicts}
    open_inputs = {
        name: entry
        for name, entry in context.spec.inputs.items()
        if entry.between is None and name not in predicted and not owner_of(name)
    }
    reads = context.stage_reads
    held = [name for name in open_inputs if ("", name) in reads.inputs]
    learned = [
        name
        for name, entry in context.spec.parameters.items()
        if entry.learn and ("", name) in reads.parameters
    ]
    if held and learned:
        first, *others = (open_inputs[name].place.key for name in held)
        context.findings.report(between.held_inputs(held, learned, first, others))
