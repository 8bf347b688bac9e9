"""Holds real values before they are rounded: polynomials of degree ≤ 2 over integer nodes.

A value stays a form as long as it is linear, so that a filter, a linear layer or an Euler step
becomes one sum with one rounding, and Σ μᵢ(x) · (wᵢ c + bᵢ) becomes c · Σ μᵢ wᵢ + Σ μᵢ bᵢ.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

from msnn.features.fixed_point.integers.builder import share

Monomial = tuple[int, ...]
"""One node, or the two nodes of a product in ascending order."""


class FormContext(Protocol):
    """Makes nodes out of forms."""

    def is_thin(self, form: PolynomialForm) -> bool:
        """Whether the form is a degree of membership, which products are expanded with."""
        ...

    def product(self, left: PolynomialForm, right: PolynomialForm) -> PolynomialForm:
        """left · right as one rounded node."""
        ...

    def size(self, monomial: Monomial) -> float:
        """The largest magnitude of a product of nodes."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class PolynomialForm:
    """constant + Σ coefficient · monomial, which is within `error` of what it stands for.

    That is 0 but where something was decided or left out by bounds alone; the errors of the nodes
    are counted where they are read.
    """

    context: FormContext
    constant: float
    terms: tuple[tuple[Monomial, float], ...] = ()
    error: float = 0.0

    @property
    def degree(self) -> int:
        return max((len(monomial) for monomial, _ in self.terms), default=0)

    @property
    def reach(self) -> float:
        """The largest magnitude that it can stand for."""
        sizes = (share(c, self.context.size(monomial)) for monomial, c in self.terms)
        return abs(self.constant) + sum(sizes) + self.error

    def within(self, error: float) -> PolynomialForm:
        """The same for something that it can be so much further from."""
        return replace(self, error=self.error + error)

    def __add__(self, other: PolynomialForm) -> PolynomialForm:
        terms = dict(self.terms)
        for monomial, coefficient in other.terms:
            terms[monomial] = terms.get(monomial, 0.0) + coefficient
        error = self.error + other.error
        return _form(self.context, self.constant + other.constant, terms, error)

    def __neg__(self) -> PolynomialForm:
        return self.times(-1.0)

    def __sub__(self, other: PolynomialForm) -> PolynomialForm:
        return self + (-other)

    def __mul__(self, other: PolynomialForm) -> PolynomialForm:
        # times a number: nothing is rounded until the form becomes a node
        if not other.terms:
            return self.times(other.constant).within(share(self.reach, other.error))
        if not self.terms:
            return other.times(self.constant).within(share(other.reach, self.error))
        # a degree of membership times few terms stays a polynomial, so that sums over neighbouring
        # sets cancel exactly; any other product is rounded to a node at once
        thin = self.context.is_thin(self) or self.context.is_thin(other)
        if thin and _is_short(self) and _is_short(other):
            return _expanded(self, other)
        return self.context.product(self, other)

    def times(self, factor: float) -> PolynomialForm:
        terms = {monomial: coefficient * factor for monomial, coefficient in self.terms}
        error = share(factor, self.error)
        return _form(self.context, self.constant * factor, terms, error)


_SHORT = 2
"""Terms of a form whose products are worth expanding."""


def _is_short(form: PolynomialForm) -> bool:
    return form.degree == 1 and len(form.terms) <= _SHORT


def _expanded(left: PolynomialForm, right: PolynomialForm) -> PolynomialForm:
    terms: dict[Monomial, float] = {}
    for first, a in (((), left.constant), *left.terms):
        for second, b in (((), right.constant), *right.terms):
            monomial = tuple(sorted((*first, *second)))
            terms[monomial] = terms.get(monomial, 0.0) + a * b
    constant = terms.pop((), 0.0)
    error = share(left.reach, right.error) + share(right.reach, left.error)
    return _form(left.context, constant, terms, error)


_NEGLIGIBLE = 1e-12
"""What is left of a coefficient that cancelled, relative to the largest."""


def _form(
    context: FormContext, constant: float, terms: dict[Monomial, float], error: float
) -> PolynomialForm:
    largest = max((abs(coefficient) for coefficient in terms.values()), default=0.0)
    kept: list[tuple[Monomial, float]] = []
    for monomial, coefficient in sorted(terms.items()):
        # what cancelled but for rounding of float64 is left out, and counted as error
        if abs(coefficient) > _NEGLIGIBLE * largest:
            kept.append((monomial, coefficient))
        else:
            error += share(coefficient, context.size(monomial))
    return PolynomialForm(context, constant, tuple(kept), error)
