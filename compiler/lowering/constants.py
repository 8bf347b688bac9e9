"""Constants, and whatever depends on constants only, as arrays that the compiler knows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeGuard

import numpy as np

from compiler.interpreter.constant_value import constant_value
from compiler.ir.scalar_functions import Array
from compiler.ir.types import Axis, describe_axes
from compiler.lowering.environment import Environment, Part
from compiler.lowering.expressions import lower
from compiler.lowering.failure import LoweringFailed
from spec_schema.diagnostics.source import Span
from spec_schema.errors import names
from spec_schema.expressions.tree import Call, Expression, LanguageName, ListLiteral, Name
from spec_schema.sections.values import Constant
from spec_schema.units.unit import ONE, Unit

if TYPE_CHECKING:
    from compiler.elaboration.names import Model


LARGEST_EYE = 1000


@dataclass(frozen=True)
class NamedArray:
    """Numbers with their axes and unit."""

    values: Array
    axes: tuple[Axis, ...]
    unit: Unit | None


class Constants:
    """The constants of a model, each evaluated once."""

    def __init__(self, model: Model) -> None:
        self._model = model
        self._constants: dict[str, NamedArray | None] = {}
        self._active: list[str] = []
        """Constants being evaluated: one that is met again needs itself."""

    def value(self, name: str, entry: Constant) -> NamedArray:
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

    def _evaluated(self, name: str, entry: Constant) -> NamedArray:
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
        axes = tuple(self._model.dimension(dim.value, dim.span) for dim in entry.dims)
        return NamedArray(self.fitted(name, found.values, axes, entry.value.span), axes, unit)

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
