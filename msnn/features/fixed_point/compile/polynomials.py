"""Represents real values before rounding: polynomials of degree ≤ 2 over integer nodes.

A linear value is not rounded. So a filter, a linear layer or an Euler step becomes one sum with one
rounding. Σ μᵢ(x) · (wᵢ c + bᵢ) becomes c · Σ μᵢ wᵢ + Σ μᵢ bᵢ.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

from msnn.features.fixed_point.integers.builder import share

Monomial = tuple[int, ...]
"""One node, or the two nodes of a product in ascending order."""


class FormContext(Protocol):
    """Makes integer nodes of forms, and knows their bounds."""

    def is_thin(self, form: PolynomialForm) -> bool:
        """True if the form consists only of ramps and choices between 0 and 1, such as membership
        degrees; products with it are expanded.
        """
        ...

    def product(self, left: PolynomialForm, right: PolynomialForm) -> PolynomialForm:
        """left · right as the form of one rounded node."""
        ...

    def size(self, monomial: Monomial) -> float:
        """The largest magnitude of the exact value of a product of nodes."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class PolynomialForm:
    """A real value before rounding: constant + Σ coefficient · monomial, within `error` of the
    exact value.

    The error is 0 unless bounds alone decided a comparison or removed a term. Errors of the nodes
    are counted where the nodes are read.
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
        """The largest possible magnitude of the exact value."""
        sizes = (share(c, self.context.size(monomial)) for monomial, c in self.terms)
        return abs(self.constant) + sum(sizes) + self.error

    def within(self, error: float) -> PolynomialForm:
        """The same form with this error added to its error bound."""
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
"""Maximum number of terms of a form whose products are expanded."""


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
"""A coefficient below this fraction of the largest one counts as cancelled."""


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
