"""States: their value, the integrator's result, and what they become after the step (R4, R6)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from compiler.builder import GraphBuilder
from compiler.lowering.environment import Environment, Part, Stage
from compiler.lowering.expressions import lower, report_unit_conflicts
from compiler.lowering.failure import LoweringFailed
from compiler.program import NodeId
from compiler.types import Axis, Type, describe_axes
from spec_schema.errors import names, shapes, time
from spec_schema.errors import states as errors
from spec_schema.expression import Call, Expression, Name
from spec_schema.integrators import Euler, Midpoint, RungeKutta4
from spec_schema.signals import State
from spec_schema.source import Span
from spec_schema.unit_parser import parse_unit

if TYPE_CHECKING:
    from compiler.lowering.model import Model

_SECOND = parse_unit("s")
_STEP = Environment(Part.STEP)

Values = dict[str, NodeId]


@dataclass(frozen=True)
class Derivative:
    """The right-hand side of one continuous state and the state's type."""

    expression: Expression
    type: Type


VectorField = dict[str, Derivative]


class States:
    """The declared states of a model."""

    def __init__(self, model: Model) -> None:
        self._model = model
        self._flow: Values | None = None
        self._next: dict[str, NodeId | None] = {}

    def value(self, name: str, entry: State, span: Span, environment: Environment) -> NodeId:
        """A state's value as the expression sees it: now, or at a stage of the integrator."""
        findings = self._model.findings
        if environment.part is Part.CONSTANT:
            findings.report(names.constant_needed(f"`{name}`", span))
            raise LoweringFailed
        if environment.part is Part.START:
            findings.report(errors.simulation_in_init(name, span))
            raise LoweringFailed
        if environment.is_elsewhere:
            return self._model.histories.read(name, entry, span, environment)
        if environment.stage is not None and name in environment.stage.values:
            return environment.stage.values[name]
        return self._model.builder(environment).state(name, self.type(entry))

    def type(self, entry: State) -> Type:
        """Axes and unit of a state."""
        return Type(self._model.arrays.axes_of(entry), entry.unit.value if entry.unit else None)

    def call(self, function: str, call: Call, environment: Environment) -> NodeId:
        """`next(x)`, `flow(x)` and `der(x)` of a state."""
        findings = self._model.findings
        if len(call.arguments) != 1 or call.keywords:
            found = len(call.arguments) + len(call.keywords)
            findings.report(
                names.wrong_argument_count(function, "1 argument", found, call.function.span)
            )
            raise LoweringFailed
        argument = call.arguments[0]
        name = argument.name if isinstance(argument, Name) else ""
        entry = self._model.spec.states.get(name)
        if entry is None:
            if function == "der":
                findings.report(names.builtin_not_yet("der of anything but a state", call.span))
            else:
                findings.report(errors.not_a_state(function, argument.span))
            raise LoweringFailed
        if environment.part in (Part.START, Part.CONSTANT) or environment.stage is not None:
            where = "a vector field" if environment.stage else environment.part.value
            findings.report(names.misplaced(function, where, call.span))
            raise LoweringFailed
        if function == "next":
            return self.next(name, entry)
        if entry.der is None:
            findings.report(errors.flow_of_discrete(name, argument.span))
            raise LoweringFailed
        if function == "der":
            return lower(self._model, entry.der, _STEP)
        return self.flow()[name]

    def next(self, name: str, entry: State) -> NodeId:
        """The value a state takes after the step: its `next:`, else the integrator's result."""
        if name not in self._next:
            self._next[name] = None  # a `next` that needs itself finds this
            self._next[name] = self._lower_next(name, entry)
        node = self._next[name]
        if node is None:
            raise LoweringFailed
        return node

    def start(self, name: str, entry: State, builder: GraphBuilder) -> NodeId:
        """The value before the first step, from `init:`; without it 0."""
        type = self.type(entry)
        if entry.init is None:
            return builder.broadcast(builder.constant(0.0, unit=type.unit), type.axes)
        node = lower(self._model, entry.init, Environment(Part.START))
        return self._fitted(f"`init` of `{name}`", node, type, entry.init, builder)

    def flow(self) -> Values:
        """The integrator's result of every continuous state, all integrated together (R6)."""
        if self._flow is None:
            self._flow = self._integrated()
        return self._flow

    # ---- inside

    def _lower_next(self, name: str, entry: State) -> NodeId:
        if entry.next is None:
            return self.flow()[name]
        builder = self._model.builder(_STEP)
        node = lower(self._model, entry.next, _STEP)
        return self._fitted(f"`next` of `{name}`", node, self.type(entry), entry.next, builder)

    def fitted(
        self, what: str, node: NodeId, axes: tuple[Axis, ...], expression: Expression
    ) -> NodeId:
        """A value of the start with exactly these axes; one without some of them is repeated."""
        builder = self._model.builder(Environment(Part.START))
        return self._fitted(what, node, Type(axes), expression, builder)

    def _fitted(
        self, what: str, node: NodeId, type: Type, expression: Expression, builder: GraphBuilder
    ) -> NodeId:
        """The value with exactly the state's axes; a value without some of them is repeated."""
        found = builder.type(node).axes
        if not set(found) <= set(type.axes):
            self._model.findings.report(
                shapes.wrong_axes(
                    what, describe_axes(type.axes), describe_axes(found), expression.span
                )
            )
            raise LoweringFailed
        if builder.type(node).unit is None:
            builder.set_unit(node, type.unit)
        return builder.broadcast(node, type.axes)

    def _integrated(self) -> Values:
        model = self._model
        vector_field = {
            name: Derivative(entry.der, self.type(entry))
            for name, entry in model.spec.states.items()
            if entry.der is not None
        }
        dt = model.sampling.sample_time
        if dt is None:
            first = next(iter(vector_field.values())).expression
            model.findings.report(time.needs_sample_time("`der:`", first.span))
            raise LoweringFailed
        builder = model.builder(_STEP)
        values = {name: builder.state(name, law.type) for name, law in vector_field.items()}
        method = model.spec.integrator.choice if model.spec.integrator else None
        substeps = method.substeps if method else 1
        step = dt / substeps
        for _ in range(substeps):
            match method:
                case Euler():
                    values = self._moved(
                        vector_field, values, self._slopes(vector_field, values), step
                    )
                case Midpoint():
                    half = self._moved(
                        vector_field, values, self._slopes(vector_field, values), step / 2
                    )
                    slopes = self._slopes(vector_field, half)
                    values = self._moved(vector_field, values, slopes, step)
                case RungeKutta4() | None:  # the default without `integrator:`
                    values = self._runge_kutta(vector_field, values, step)
        return values

    def _slopes(self, vector_field: VectorField, values: Values) -> Values:
        """The derivatives, every memoryless equation between states and `der` evaluated anew."""
        stage = Environment(Part.STEP, stage=Stage(values))
        builder = self._model.builder(stage)
        slopes: Values = {}
        failed = False
        for name, law in vector_field.items():
            try:
                node = lower(self._model, law.expression, stage)
                type = law.type.with_unit(None)
                slopes[name] = self._fitted(
                    f"`der` of `{name}`", node, type, law.expression, builder
                )
            except LoweringFailed:
                failed = True
        if failed:
            raise LoweringFailed
        return slopes

    def _moved(
        self, vector_field: VectorField, values: Values, slopes: Values, step: float
    ) -> Values:
        """values + step · slopes."""
        builder = self._model.builder(_STEP)
        moved: Values = {}
        for name, law in vector_field.items():
            with builder.at(law.expression.span):
                scaled = builder.multiply(builder.constant(step, unit=_SECOND), slopes[name])
                moved[name] = builder.add(values[name], scaled)
            report_unit_conflicts(self._model, builder, law.expression)
        return moved

    def _runge_kutta(self, vector_field: VectorField, values: Values, step: float) -> Values:
        """x + h/6 · (k₁ + 2(k₂ + k₃) + k₄), the classical method (Kutta 1901)."""
        builder = self._model.builder(_STEP)
        k1 = self._slopes(vector_field, values)
        k2 = self._slopes(vector_field, self._moved(vector_field, values, k1, step / 2))
        k3 = self._slopes(vector_field, self._moved(vector_field, values, k2, step / 2))
        k4 = self._slopes(vector_field, self._moved(vector_field, values, k3, step))
        two = builder.constant(2.0)
        total: Values = {}
        for name in values:
            middle = builder.multiply(two, builder.add(k2[name], k3[name]))
            total[name] = builder.add(builder.add(k1[name], middle), k4[name])
        return self._moved(vector_field, values, total, step / 6)
