"""Constants and parameters as arrays: values, axes and units that the compiler knows."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeGuard

import numpy as np

from compiler.builder import GraphBuilder
from compiler.constant_value import constant_value
from compiler.lowering.environment import Environment, Part
from compiler.lowering.expressions import lower
from compiler.lowering.failure import LoweringFailed
from compiler.lowering.initial_values import initial_values
from compiler.lowering.ranges import limit_in
from compiler.program import NodeId, Parameter, Statistic
from compiler.scalar_functions import Array
from compiler.types import Axis, Type, describe_axes
from compiler.unit_rules import same_unit
from spec_schema.errors import names, units
from spec_schema.expression import Call, Expression, LanguageName, ListLiteral, Name
from spec_schema.located import Located
from spec_schema.signals import Equation, Output, Signal, State
from spec_schema.source import Span
from spec_schema.units import ONE, Unit
from spec_schema.values import Constant as ConstantEntry
from spec_schema.values import Parameter as ParameterEntry

if TYPE_CHECKING:
    from compiler.lowering.model import Model


LARGEST_EYE = 1000


@dataclass(frozen=True)
class NamedArray:
    """Numbers with their axes and unit."""

    values: Array
    axes: tuple[Axis, ...]
    unit: Unit | None


class Arrays:
    """The constants and parameters of a model, each evaluated or declared once."""

    def __init__(self, model: Model) -> None:
        self._model = model
        self._constants: dict[str, NamedArray | None] = {}
        self._parameters: dict[str, Parameter] = {}
        self._active: list[str] = []
        """Constants being evaluated: one that is met again needs itself."""
        self._failed: set[str] = set()
        self.given: set[str] = set()
        """Those whose values the weights of a sub-model give."""

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Everything learnable, in the order of first use."""
        return tuple(p for p in self._parameters.values() if not self._is_constant(p))

    @property
    def all_names(self) -> tuple[str, ...]:
        """Parameters and those that sub-models hold constant."""
        return tuple(self._parameters)

    def read(self, builder: GraphBuilder, name: str) -> NodeId:
        """The value of a declared parameter: a constant where its sub-model is frozen (R11)."""
        found = self._parameters[name]
        if not self._is_constant(found):
            return builder.parameter(name, Type(found.axes, found.unit))
        node = builder.constant(found.initial, found.axes, found.unit)
        builder.name(node, name)
        return node

    # ---- constants

    def constant(self, name: str, entry: ConstantEntry) -> NamedArray:
        """The value of a `constants:` entry."""
        if name in self._active:
            circle = (*self._active[self._active.index(name) :], name)
            self._model.findings.report(names.circular_constant(circle, entry.value.span))
            raise LoweringFailed
        if name not in self._constants:
            self._constants[name] = None  # what a failed one leaves: its mistake is reported
            self._active.append(name)
            try:
                self._constants[name] = self._evaluated(name, entry)
            finally:
                self._active.pop()
        found = self._constants[name]
        if found is None:
            raise LoweringFailed
        return found

    def number(self, expression: Expression, what: str) -> float:
        """The number of an expression that depends on constants only."""
        array = self.evaluate(expression)
        if array.axes:
            found = describe_axes(array.axes)
            self._model.findings.report(
                names.unfit_constant(what, f"is {found}, not one number", expression.span)
            )
            raise LoweringFailed
        return float(array.values)

    def evaluate(self, expression: Expression) -> NamedArray:
        """The array of an expression that depends on constants only."""
        return self.evaluate_in(expression, Environment(Part.CONSTANT))

    def evaluate_in(self, expression: Expression, environment: Environment) -> NamedArray:
        """The same where names stand for more than the constants."""
        if isinstance(expression, ListLiteral) and any(
            isinstance(element, ListLiteral) for element in expression.elements
        ):
            return self._matrix(expression)
        if self._is_eye(expression):
            return self._eye(expression)
        node = lower(self._model, expression, environment)
        builder = self._model.builder(environment)
        type = builder.type(node)
        return NamedArray(constant_value(builder.graph(), node), type.axes, type.unit)

    def _is_eye(self, expression: Expression) -> TypeGuard[Call]:
        """Whether this is `eye` of a number; with two names it is a matrix of these dims."""
        return (
            isinstance(expression, Call)
            and isinstance(expression.function, Name)
            and expression.function.name == "eye"
            and (isinstance(expression.function, LanguageName) or "eye" not in self._model.scope)
            and len(expression.arguments) == 1
        )

    def _eye(self, call: Call) -> NamedArray:
        """`eye(3)`: its axes get their names from `dims:` too."""
        (argument,) = call.arguments
        size = self.number(argument, "the size of `eye`")
        if not (size.is_integer() and 1 <= size <= LARGEST_EYE):
            problem = f"is no whole number from 1 to {LARGEST_EYE}"
            report = names.unfit_constant("the size of `eye`", problem, argument.span)
            self._model.findings.report(report)
            raise LoweringFailed
        axis = Axis("", int(size))
        return NamedArray(np.eye(axis.size), (axis, axis), ONE)

    def _matrix(self, rows: ListLiteral) -> NamedArray:
        parts = [self.evaluate(row).values for row in rows.elements]
        if len({part.shape for part in parts}) > 1:
            self._model.findings.report(
                names.unfit_constant("this list", "has rows of different lengths", rows.span)
            )
            raise LoweringFailed
        # Axes get their names from `dims:`; until then only the sizes matter.
        values = np.array(parts)
        return NamedArray(values, tuple(Axis("", size) for size in values.shape), ONE)

    def _evaluated(self, name: str, entry: ConstantEntry) -> NamedArray:
        found = self.evaluate(entry.value)
        unit = entry.unit.value if entry.unit else found.unit
        if not entry.dims:
            if len([axis for axis in found.axes if not axis.name]) > 1:
                self._model.findings.report(
                    names.unfit_constant(
                        f"`{name}`", "is a matrix and needs `dims:`", entry.value.span
                    )
                )
                raise LoweringFailed
            return NamedArray(found.values, found.axes, unit)
        axes = self._dims(entry.dims)
        return NamedArray(self.fitted(name, found.values, axes, entry.value.span), axes, unit)

    # ---- parameters

    def parameter(self, name: str, entry: ParameterEntry) -> Type:
        """The type of a `parameters:` entry, declared at its first use."""
        if name in self._failed:
            raise LoweringFailed
        if name not in self._parameters:
            self._failed.add(name)
            self._parameters[name] = self._with_given(self._declared(name, entry))
            self._failed.remove(name)
        found = self._parameters[name]
        return Type(found.axes, found.unit)

    def _declared(self, name: str, entry: ParameterEntry) -> Parameter:
        axes = self._dims(entry.dims)
        unit = entry.unit.value if entry.unit else None
        initial = initial_values(self._model, name, entry.init, axes)
        low = None if entry.min is None else limit_in(self._model, entry.min, unit)
        high = None if entry.max is None else limit_in(self._model, entry.max, unit)
        span = entry.init.place.value
        if low is not None and high is not None and low >= high:
            assert entry.min is not None
            self._model.findings.report(
                names.unfit_constant(f"`{name}`", "has min at or above max", entry.min.span)
            )
            raise LoweringFailed
        outside = bool(
            (low is not None and np.any(initial <= low))
            or (high is not None and np.any(initial >= high))
        )
        if outside:
            least = "-inf" if low is None else f"{low:g}"
            most = "inf" if high is None else f"{high:g}"
            problem = f"must lie inside its bounds {least} … {most}, not on or beyond them"
            self._model.findings.report(names.unfit_constant(f"`{name}`", problem, span))
            raise LoweringFailed
        return Parameter(
            name,
            axes,
            unit,
            tuple(float(v) for v in initial.ravel()),
            low,
            high,
            entry.scale or 1.0,
            entry.learn,
            doc=entry.doc or "",
            span=entry.place.key,
        )

    def declare(
        self,
        name: str,
        axes: tuple[Axis, ...],
        initial: Array,
        unit: Unit | None,
        doc: str,
        span: Span,
        bounds: tuple[float | None, float | None],
        statistic: Statistic | None = None,
    ) -> Type:
        """An array of a layer; a second call of the layer finds the first one's.

        It is learned unless it is a statistic of the data.
        """
        found = self._parameters.get(name)
        if found is None:
            values = tuple(float(v) for v in initial.ravel())
            low, high = bounds
            learn = statistic is None
            found = Parameter(
                name, axes, unit, values, low, high, 1.0, learn, statistic, doc=doc, span=span
            )
            found = self._parameters[name] = self._with_given(found)
        return Type(found.axes, found.unit)

    def _with_given(self, parameter: Parameter) -> Parameter:
        """The parameter with the value that the weights of its sub-model have."""
        shape = tuple(axis.size for axis in parameter.axes)
        given = self._model.given.value(parameter.name, shape)
        if given is None:
            return parameter
        self.given.add(parameter.name)
        values = tuple(float(value) for value in given.ravel())
        return replace(parameter, initial=values, statistic=None)  # which is known then

    def _is_constant(self, parameter: Parameter) -> bool:
        """Frozen with its sub-model; a statistic that no weights give is first to be found."""
        return parameter.statistic is None and self._model.given.is_frozen(parameter.name)

    # ---- axes and units of entries

    def axes_of(self, entry: Signal | State) -> tuple[Axis, ...]:
        """The axes that an entry's `dims:` name."""
        return self._dims(entry.dims)

    def agree_on_unit(
        self, builder: GraphBuilder, node: NodeId, name: str, entry: Equation | Output
    ) -> None:
        """Gives a value of unknown unit the declared one; reports one that is known and differs."""
        if entry.unit is None:
            return
        found = builder.type(node).unit
        if found is None:
            builder.set_unit(node, entry.unit.value)
        elif not same_unit(found, entry.unit.value):
            self._model.findings.report(
                units.declared_unit_differs(
                    name, found.text, entry.unit.value.text, entry.expr.span
                )
            )

    def _dims(self, dims: tuple[Located[str], ...]) -> tuple[Axis, ...]:
        return tuple(self._model.dimension(dim.value, dim.span) for dim in dims)

    def fitted(self, name: str, values: Array, axes: tuple[Axis, ...], span: Span) -> Array:
        """Numbers in the shape of the axes: one for all, or exactly so many."""
        shape = tuple(axis.size for axis in axes)
        if values.shape not in ((), shape):
            problem = f"has the shape {list(values.shape)}, not {describe_axes(axes)}"
            self._model.findings.report(names.unfit_constant(f"`{name}`", problem, span))
            raise LoweringFailed
        if not np.all(np.isfinite(values)):
            self._model.findings.report(names.unfit_constant(f"`{name}`", "is not finite", span))
            raise LoweringFailed
        return np.broadcast_to(values, shape)
