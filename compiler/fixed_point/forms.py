"""Real values before they are rounded: polynomials of degree at most 2 over integer nodes.

A value stays a form as long as it is linear, so that a filter, a linear layer or an Euler step
becomes one sum with one rounding, and Σ μᵢ(x) · (wᵢ c + bᵢ) becomes c · Σ μᵢ wᵢ + Σ μᵢ bᵢ.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

Monomial = tuple[int, ...]
"""One node, or the two nodes of a product in ascending order."""


class FormContext(Protocol):
    """What makes nodes out of forms."""

    def is_thin(self, form: Form) -> bool:
        """Whether the form is a degree of membership, which products are expanded with."""
        ...

    def product(self, left: Form, right: Form) -> Form:
        """left · right as one rounded node."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Form:
    """constant + Σ coefficient · monomial."""

    context: FormContext
    constant: float
    terms: tuple[tuple[Monomial, float], ...] = ()

    @property
    def degree(self) -> int:
        return max((len(monomial) for monomial, _ in self.terms), default=0)

    def __add__(self, other: Form) -> Form:
        terms = dict(self.terms)
        for monomial, coefficient in other.terms:
            terms[monomial] = terms.get(monomial, 0.0) + coefficient
        return _form(self.context, self.constant + other.constant, terms)

    def __neg__(self) -> Form:
        return self.times(-1.0)

    def __sub__(self, other: Form) -> Form:
        return self + (-other)

    def __mul__(self, other: Form) -> Form:
        if not other.terms:
            return self.times(other.constant)
        if not self.terms:
            return other.times(self.constant)
        thin = self.context.is_thin(self) or self.context.is_thin(other)
        if thin and _is_short(self) and _is_short(other):
            return _expanded(self, other)
        return self.context.product(self, other)

    def times(self, factor: float) -> Form:
        terms = {monomial: coefficient * factor for monomial, coefficient in self.terms}
        return _form(self.context, self.constant * factor, terms)


_SHORT = 2
"""Terms of a form whose products are worth expanding."""


def _is_short(form: Form) -> bool:
    return form.degree == 1 and len(form.terms) <= _SHORT


def _expanded(left: Form, right: Form) -> Form:
    terms: dict[Monomial, float] = {}
    for first, a in (((), left.constant), *left.terms):
        for second, b in (((), right.constant), *right.terms):
            monomial = tuple(sorted((*first, *second)))
            terms[monomial] = terms.get(monomial, 0.0) + a * b
    constant = terms.pop((), 0.0)
    return _form(left.context, constant, terms)


_NEGLIGIBLE = 1e-12
"""What is left of a coefficient that cancelled, relative to the largest."""


def _form(context: FormContext, constant: float, terms: dict[Monomial, float]) -> Form:
    largest = max((abs(coefficient) for coefficient in terms.values()), default=0.0)
    kept = [(m, c) for m, c in sorted(terms.items()) if abs(c) > _NEGLIGIBLE * largest]
    return Form(context, constant, tuple(kept))
