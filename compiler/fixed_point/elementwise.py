"""Operations on single values that are not linear: extremes, choices, functions, quotients."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from compiler.fixed_point.forms import Form
from compiler.fixed_point.integers.builder import CannotFitError
from compiler.fixed_point.settle import Settler
from compiler.fixed_point.tables import fitted_table
from compiler.ir.ops import Relation
from compiler.ir.scalars.table import SCALAR_FUNCTIONS


@dataclass(frozen=True, slots=True)
class Condition:
    """left relation right, of nodes at one scale."""

    relation: Relation
    left: int
    right: int


class Elementwise(Settler):
    """What makes nodes out of operations that end a linear form."""

    def quotient(self, left: Form, right: Form) -> Form:
        """left / right, by a table of reciprocals where right varies."""
        if not right.terms:
            return left.times(1.0 / right.constant)
        return left * self._tabled("1/x", np.reciprocal, right)

    def lesser(self, left: Form, right: Form) -> Form:
        """min(left, right)."""
        return self._extreme(left, right, largest=False)

    def greater(self, left: Form, right: Form) -> Form:
        """max(left, right)."""
        return self._extreme(left, right, largest=True)

    def _extreme(self, left: Form, right: Form, *, largest: bool) -> Form:
        if not left.terms and not right.terms:
            pick = max if largest else min
            return self.number(pick(left.constant, right.constant))
        a, b = self._aligned(left, right)
        found = self.builder.larger(a, b) if largest else self.builder.smaller(a, b)
        return self._simple(found)

    def _simple(self, node: int) -> Form:
        low, high = self.builder.bounds(node)
        return self.number(low) if low == high else self.form(node)

    def condition(self, relation: Relation, left: Form, right: Form) -> Condition | bool:
        """left relation right; a bool where it is known, from the bounds of both too."""
        if not left.terms and not right.terms:
            return _holds(relation, left.constant, right.constant)
        first, second = self._aligned(left, right)
        a, b = self.builder[first], self.builder[second]
        most, least = (_holds(relation, *ends) for ends in ((a.low, b.high), (a.high, b.low)))
        return most if most == least else Condition(relation, first, second)

    def _aligned(self, left: Form, right: Form) -> tuple[int, int]:
        """Both values at one scale; a number that is out of reach stays beyond all values."""
        forms = (left, right)
        for this, other in (forms, forms[::-1]):
            if not this.terms:
                node = self.node(other)
                found = self.builder[node]
                scaled = math.ldexp(this.constant, found.fraction)
                value = round(min(max(scaled, found.low - 1), found.high + 1))
                literal = self.builder.literal(value, found.fraction)
                return (literal, node) if this is left else (node, literal)
        a, b = self.node(left), self.node(right)
        fraction = max(self.builder[a].fraction, self.builder[b].fraction)
        while True:
            try:
                return self.builder.to_fraction(a, fraction), self.builder.to_fraction(b, fraction)
            except CannotFitError:
                fraction -= 1

    def selected(self, condition: Condition | bool, then: Form, otherwise: Form) -> Form:
        """A choice; one between two numbers is linear in a node that is 0 or 1."""
        if not isinstance(condition, Condition):
            return then if condition else otherwise
        relation, left, right = condition.relation, condition.left, condition.right
        if not then.terms and not otherwise.terms:
            one, zero = self.builder.literal(1, 0), self.builder.literal(0, 0)
            chosen = self.builder.choose(relation, left, right, one, zero)
            self.indicators.add(chosen)
            difference = then.constant - otherwise.constant
            return self.form(chosen).times(difference) + self.number(otherwise.constant)
        a, b = self._same_scale(then, otherwise)
        return self.form(self.builder.choose(relation, left, right, a, b))

    def _same_scale(self, left: Form, right: Form) -> tuple[int, int]:
        """As `_aligned`, with numbers kept as they are."""
        a, b = self.node(left), self.node(right)
        fractions = [self.builder[n].fraction for n, f in ((a, left), (b, right)) if f.terms]
        fraction = max(fractions)
        while True:
            try:
                return self.builder.to_fraction(a, fraction), self.builder.to_fraction(b, fraction)
            except CannotFitError:
                fraction -= 1

    def applied(self, function: str, *forms: Form) -> Form:
        """A function of the table in `scalars/table.py`."""
        row = SCALAR_FUNCTIONS[function]
        if all(not form.terms for form in forms):
            return self.number(float(row.numpy(*(np.float64(f.constant) for f in forms))))
        if len(forms) != 1:
            raise CannotFitError(f"calls `{function}` of more than one variable")
        form = forms[0]
        if function == "abs":
            return self._simple(self.builder.magnitude(self.node(form)))
        if function == "sign":
            zero = self.number(0.0)
            above = self.selected(
                self.condition(Relation.GREATER, form, zero), self.number(1.0), zero
            )
            below = self.condition(Relation.LESS, form, zero)
            return above - self.selected(below, self.number(1.0), zero)
        return self._tabled(function, row.numpy, form)

    def _tabled(self, name: str, function: Callable[[Any], Any], form: Form) -> Form:
        builder = self.builder
        node = builder.as_word(self.node(form))
        found = builder[node]
        try:
            fitted = fitted_table(
                name, function, builder.width, (found.low, found.high, found.fraction)
            )
        except CannotFitError as error:
            raise CannotFitError(f"calls `{name}`, which {error}") from None
        argument = builder.saturated(node, fitted.low, fitted.high)
        return self._simple(builder.lookup(argument, fitted.table, fitted.fraction))


def _holds(relation: Relation, left: float, right: float) -> bool:
    match relation:
        case Relation.LESS:
            return left < right
        case Relation.LESS_EQUAL:
            return left <= right
        case Relation.GREATER:
            return left > right
        case Relation.GREATER_EQUAL:
            return left >= right
