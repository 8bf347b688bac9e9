"""Lowers nonlinear operations to integers: minimum, maximum, choices, functions, quotients."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from compiler.ir.ops import Relation
from compiler.ir.scalars import SCALAR_FUNCTIONS
from msnn.features.fixed_point.compile.polynomials import PolynomialForm
from msnn.features.fixed_point.compile.settle import Settler
from msnn.features.fixed_point.compile.tables import fitted_table, furthest
from msnn.features.fixed_point.compile.thresholds import Decided, IntegerCondition, reach_beside
from msnn.features.fixed_point.integers.builder import CannotFitError, share


class ElementwiseForms(Settler):
    """Makes forms of operations whose result is not linear in their operands. Raises CannotFitError
    where no integer node can represent a value.
    """

    def quotient(self, left: PolynomialForm, right: PolynomialForm) -> PolynomialForm:
        """left / right; for a right side that varies, left times a value from a table of
        reciprocals.
        """
        if not right.terms:
            form = left.times(1.0 / right.constant)
            end = abs(right.constant)
            return form.within(
                share(left.reach, furthest("1/x", end, end, right.error)) if right.error else 0.0
            )
        return left * self._tabled("1/x", np.reciprocal, right)

    def lesser(self, left: PolynomialForm, right: PolynomialForm) -> PolynomialForm:
        """min(left, right)."""
        return self._extreme(left, right, largest=False)

    def greater(self, left: PolynomialForm, right: PolynomialForm) -> PolynomialForm:
        """max(left, right)."""
        return self._extreme(left, right, largest=True)

    def _extreme(
        self, left: PolynomialForm, right: PolynomialForm, *, largest: bool
    ) -> PolynomialForm:
        if not left.terms and not right.terms:
            pick = max if largest else min
            error = max(left.error, right.error)
            return self.number(pick(left.constant, right.constant)).within(error)
        for number, other in ((left, right), (right, left)):
            if not number.terms and self._is_beyond(number, other, above=largest):
                error = self._overshoot(number, other, above=largest)
                return self.number(number.constant).within(max(number.error, error))
        a, b = self._aligned(left, right)
        found = self.builder.larger(a, b) if largest else self.builder.smaller(a, b)
        return self._simple(found)

    def _is_beyond(self, number: PolynomialForm, other: PolynomialForm, *, above: bool) -> bool:
        """True if the constant form `number` lies above (or, for `above` False, below) every value
        of the node of `other`.

        `_aligned` may move such a constant closer without changing a comparison. As the result of
        `min` or `max` it must not move.
        """
        found = self.builder[self.node(other)]
        scaled = math.ldexp(number.constant, found.fraction)
        return scaled > found.high if above else scaled < found.low

    def _overshoot(self, number: PolynomialForm, other: PolynomialForm, *, above: bool) -> float:
        """The maximum by which the real value of `other` exceeds a constant that is beyond its
        node, due to the node's error.
        """
        node = self.node(other)
        low, high = self.builder.bounds(node)
        apart = number.constant - high if above else low - number.constant
        return max(self.builder.errors[node] - apart, 0.0)

    def _simple(self, node: int) -> PolynomialForm:
        low, high = self.builder.bounds(node)
        if low == high:
            return self.number(low).within(self.builder.errors[node])
        return self.form(node)

    def condition(
        self, relation: Relation, left: PolynomialForm, right: PolynomialForm
    ) -> IntegerCondition | Decided:
        """The condition `left relation right`; decided at compile time if the bounds of both sides
        allow it.
        """
        if not left.terms and not right.terms:
            error = left.error + right.error
            is_sure = not error or abs(left.constant - right.constant) > error
            return Decided(relation.holds(left.constant, right.constant), is_sure)
        first, second = self._aligned(left, right)
        a, b = self.builder[first], self.builder[second]
        most, least = (relation.holds(*ends) for ends in ((a.low, b.high), (a.high, b.low)))
        if most == least:
            return Decided(most, not self.builder.is_doubtful(first, second))
        return IntegerCondition(relation, first, second, left - right)

    def _aligned(self, left: PolynomialForm, right: PolynomialForm) -> tuple[int, int]:
        """Nodes of both values at one scale, for a comparison. A constant beyond the bounds of the
        other side is moved closer, but stays beyond.
        """
        forms = (left, right)
        for this, other in (forms, forms[::-1]):
            if not this.terms:
                node = self.node(other)
                found = self.builder[node]
                scaled = math.ldexp(this.constant, found.fraction)
                room = self._room(node)
                value = round(min(max(scaled, found.low - room), found.high + room))
                # beyond all that the node can stand for every number is alike
                is_near = found.low - room <= scaled <= found.high + room
                error = abs(math.ldexp(value, -found.fraction) - this.constant) if is_near else 0.0
                literal = self.builder.literal(value, found.fraction, error + this.error)
                return (literal, node) if this is left else (node, literal)
        a, b = self.node(left), self.node(right)
        # the finer scale if both fit in it, else the finest in which both do
        fraction = max(self.builder[a].fraction, self.builder[b].fraction)
        while True:
            try:
                return self.builder.to_fraction(a, fraction), self.builder.to_fraction(b, fraction)
            except CannotFitError:
                fraction -= 1

    def _room(self, node: int) -> int:
        """A distance from the bounds of a node, in its units, that its real value cannot exceed."""
        found = self.builder[node]
        units = math.ldexp(self.builder.errors[node], found.fraction)
        # no more than a sum has bits for: nearer numbers decide the same, and may be in doubt
        fits = self.builder.width.largest_sum - max(-found.low, found.high)
        return max(math.floor(min(units, fits - 1)) + 1, 1)

    def selected(
        self, condition: IntegerCondition | Decided, then: PolynomialForm, otherwise: PolynomialForm
    ) -> PolynomialForm:
        """`then` if the condition holds, else `otherwise`. A choice between two constants is linear
        in a node that is 0 or 1.
        """
        if isinstance(condition, Decided):
            taken = then if condition.holds else otherwise
            return taken if condition.is_sure else taken.within(then.reach + otherwise.reach)
        relation, left, right = condition.relation, condition.left, condition.right
        if not then.terms and not otherwise.terms:
            one, zero = self.builder.literal(1, 0), self.builder.literal(0, 0)
            chosen = self.builder.choose(relation, left, right, one, zero)
            # a wrong decision counts only beside its threshold: products ask which one it was
            self.indicators[chosen] = condition
            difference = then.constant - otherwise.constant
            form = self.form(chosen).times(difference) + self.number(otherwise.constant)
            return form.within(max(then.error, otherwise.error))
        a, b = self._same_scale(then, otherwise)
        apart = reach_beside(self.builder, condition, then - otherwise)
        return self.form(self.builder.choose(relation, left, right, a, b, apart))

    def _same_scale(self, left: PolynomialForm, right: PolynomialForm) -> tuple[int, int]:
        """Nodes of both values at one scale, like `_aligned`, but constants keep their values."""
        a, b = self.node(left), self.node(right)
        fractions = [self.builder[n].fraction for n, f in ((a, left), (b, right)) if f.terms]
        # numbers follow the node beside them: rounded to its scale they cost no shift in the step
        fraction = max(fractions)
        while True:
            try:
                return self.builder.to_fraction(a, fraction), self.builder.to_fraction(b, fraction)
            except CannotFitError:
                fraction -= 1

    def applied(self, function: str, *forms: PolynomialForm) -> PolynomialForm:
        """A scalar function, by its name in `SCALAR_FUNCTIONS`, of the forms: exact for constants,
        else from a table. Raises CannotFitError for several variables, and if no table is accurate
        enough.
        """
        row = SCALAR_FUNCTIONS[function]
        if all(not form.terms for form in forms):
            value = self.number(float(row.numpy(*(np.float64(f.constant) for f in forms))))
            if not any(form.error for form in forms):
                return value
            (end, off) = forms[0].constant, forms[0].error
            return value.within(furthest(function, end, end, off) if len(forms) == 1 else math.inf)
        if len(forms) != 1:
            raise CannotFitError(f"calls `{function}` of more than one variable")
        form = forms[0]
        if function == "abs":
            return self._simple(self.builder.magnitude(self.node(form)))
        if function == "sign":
            zero = self.number(0.0)
            # sign(0) is 0, for which one choice is not enough
            above = self.selected(
                self.condition(Relation.GREATER, form, zero), self.number(1.0), zero
            )
            below = self.condition(Relation.LESS, form, zero)
            return above - self.selected(below, self.number(1.0), zero)
        return self._tabled(function, row.numpy, form)

    def _tabled(
        self, name: str, function: Callable[[Any], Any], form: PolynomialForm
    ) -> PolynomialForm:
        builder = self.builder
        node = builder.as_word(self.node(form))
        found = builder[node]
        try:
            fitted = fitted_table(
                name, function, builder.width, (found.low, found.high, found.fraction)
            )
        except CannotFitError as error:
            raise CannotFitError(f"calls `{name}`, which {error}") from None
        error = fitted.error + furthest(name, *builder.bounds(node), builder.errors[node])
        # the table ends where its function is flat: an argument beyond has the value of the end
        argument = builder.saturated(node, fitted.low, fitted.high)
        value = builder.lookup(argument, fitted.table, fitted.fraction)
        return self._simple(builder.allow(value, error))
