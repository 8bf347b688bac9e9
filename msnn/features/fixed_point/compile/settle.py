"""Turns a form into one integer node: chooses scale, coefficients and bounds."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass

from msnn.features.fixed_point.compile.polynomials import Monomial, PolynomialForm
from msnn.features.fixed_point.compile.thresholds import IntegerCondition, reach_beside
from msnn.features.fixed_point.integers.builder import CannotFitError, IntegerBuilder, share
from msnn.features.fixed_point.integers.program import Width

_ROOM = 0.9
"""Fraction of the range of a sum that values may fill; the rest is reserved for rounding."""

_ROUNDING = 2.0**-45
"""Relative float64 rounding error of a term in a sum of hundreds; the reference rounds too."""

_FINEST = 2**10
"""Number of fraction digits that exceeds every scale in use."""

_WORTH_A_SHIFT = 3
"""Minimum gain in bits of coefficients that justifies summing some terms separately."""


_Key = tuple[float, tuple[tuple[Monomial, float], ...]]


@dataclass(frozen=True, slots=True)
class Ramp:
    """A node that rises from 0 while x crosses one interval of a chain of adjacent intervals.
    `chain` identifies the chain, `place` is the index of the interval.

    A ramp begins where the previous one ends. So sums over the ramps of a chain are bounded by
    their values at the interval ends.
    """

    chain: int
    place: int


class Settler:
    """Turns the forms of one graph into integer nodes; equal forms become one node."""

    def __init__(self, width: Width) -> None:
        self.builder = IntegerBuilder(width)
        self.ramps: dict[int, Ramp] = {}
        self.indicators: dict[int, IntegerCondition] = {}
        self._settled: dict[_Key, tuple[int, float]] = {}

    def form(self, node: int) -> PolynomialForm:
        return PolynomialForm(self, 0.0, (((node,), 1.0),))

    def number(self, value: float) -> PolynomialForm:
        return PolynomialForm(self, value)

    def is_thin(self, form: PolynomialForm) -> bool:
        return all(n in self.ramps or n in self.indicators for m, _ in form.terms for n in m)

    def size(self, monomial: Monomial) -> float:
        return math.prod(self.builder.reach(node) + self.builder.errors[node] for node in monomial)

    def product(self, left: PolynomialForm, right: PolynomialForm) -> PolynomialForm:
        (one, mine), (other, its) = self._factor(left), self._factor(right)
        error = min(
            self._beside((left, one, mine), (right, other, its)),
            self._beside((right, other, its), (left, one, mine)),
        )
        # x·y and y·x are one node
        first, second = sorted((one, other))
        node = self.builder.product(first, second, error / abs(mine * its))
        return self.form(node).times(mine * its)

    def _factor(self, form: PolynomialForm) -> tuple[int, float]:
        """A factor of a product as (word, coefficient), a node and a number: the factor is
        coefficient · word.
        """
        if form.degree != 1 or len(form.terms) != 1 or form.constant != 0.0:
            return self.builder.as_word(self.node(form)), 1.0
        (((node,), coefficient),) = form.terms
        if form.error:
            # the word is taken as it is, so the form's own error counts for it: error /
            # |coefficient|
            known = self.builder.errors[node]
            self.builder.allow(node, known + form.error / abs(coefficient))
        return self.builder.as_word(node), coefficient

    def _beside(
        self, decided: tuple[PolynomialForm, int, float], other: tuple[PolynomialForm, int, float]
    ) -> float:
        """A bound on the error of a product d·r whose factor d is a sum of decisions (nodes that
        are 0 or 1); inf for other factors.

        A decision can be wrong by 1 only near its threshold, where r may be small. Both arguments
        are (form, word, coefficient) with form = coefficient · word.
        """
        (form, word, times), (right, factor, its) = decided, other
        errors, reach = self.builder.errors, self.builder.reach
        wrong = rest = 0.0
        for monomial, coefficient in form.terms:
            condition = self.indicators.get(monomial[0]) if len(monomial) == 1 else None
            if condition is None:
                return math.inf
            wrong += share(coefficient, reach_beside(self.builder, condition, right))
            rest += share(coefficient, errors[monomial[0]])
        if not form.terms or not math.isfinite(errors[word]):
            return math.inf
        # what is left of the error of d is that of its rounding, wherever r is
        rounding = max(share(times, errors[word]) - rest, 0.0)
        by_right = share(times * reach(word), share(its, errors[factor]))
        return wrong + share(right.reach, rounding) + by_right

    def node(self, form: PolynomialForm) -> int:
        """The integer node that represents the form's value. Raises CannotFitError if no scale
        does.
        """
        # without the error: equal forms are one node, which has the larger of their errors
        key = form.constant, form.terms
        if key not in self._settled:
            node = self._linear(form.constant, self._degree_one(form))
            self._settled[key] = node, self.builder.errors[node]
        node, error = self._settled[key]
        return self.builder.allow(node, error + form.error)

    def _degree_one(self, form: PolynomialForm) -> list[tuple[int, float]]:
        """The terms of a form as (node, coefficient), after its products became nodes; common
        factors are taken out first.
        """
        linear = [(m[0], c) for m, c in form.terms if len(m) == 1]
        rest = {m: c for m, c in form.terms if len(m) > 1}
        while rest:
            # a·b + a·c = a·(b + c): one product in place of two, by the factor that most products
            # have
            counts = Counter(node for monomial in rest for node in set(monomial))
            # ramps last, as their sums are bounded by chains; the number of the node makes ties
            # fall alike
            shared = max(counts, key=lambda node: (counts[node], node not in self.ramps, node))
            inner: dict[Monomial, float] = {}
            for monomial in [m for m in rest if shared in m]:
                other = monomial[1] if monomial[0] == shared else monomial[0]
                inner[other,] = rest.pop(monomial)
            found = self.product(
                self.form(shared), PolynomialForm(self, 0.0, tuple(sorted(inner.items())))
            )
            linear += [(m[0], c) for m, c in found.terms]
        return linear

    def _linear(self, constant: float, terms: list[tuple[int, float]]) -> int:
        if not terms:
            return self._constant(constant)
        # the scale of a sum is the finest at which no partial sum overflows; finer than the finest
        # operand it holds nothing more
        terms = self._apart(sorted(terms, key=self._order))
        fraction = self._largest_fraction(constant, terms)
        exact = [self._exact_fraction(node, c) for node, c in terms]
        if all(bits is not None for bits in exact):
            needed = max(bits for bits in exact if bits is not None)
            fraction = min(fraction, max(needed, self._fraction_of(constant, terms)))
        while True:
            scaled = [self._scaled(node, c, fraction) for node, c in terms]
            # a coefficient must be a word itself: where one is not, the whole sum gets a coarser
            # scale
            excess = max(abs(c) for c, _ in scaled)
            # powers of two are shifts: no coefficient has to fit a word
            if excess <= self.builder.width.largest_word or all(e is not None for e in exact):
                break
            fraction -= 1
        # a coefficient that rounds to 0 leaves its term out; the error below counts all of it
        kept = [(c, node) for c, node in scaled if c != 0]
        rounded = round(math.ldexp(constant, fraction))
        error = abs(math.ldexp(rounded, -fraction) - constant)
        for (whole, operand), (_, coefficient) in zip(scaled, terms, strict=True):
            error += self._term_error(whole, operand, coefficient, fraction)
        if len(terms) > 1 or constant or any(bits is None for bits in exact):
            sizes = (share(c, self.builder.reach(node)) for node, c in terms)
            error += _ROUNDING * (abs(constant) + sum(sizes))
        if not kept:
            return self.builder.literal(rounded, fraction, error)
        low, high = self._bounds([(node, c) for c, node in kept], integer=True)
        bounds = (rounded + int(low), rounded + int(high))
        return self.builder.allow(self.builder.weighted_sum(rounded, kept, fraction, bounds), error)

    def _term_error(self, whole: int, operand: int, coefficient: float, fraction: int) -> float:
        """|c′ v − c x| ≤ |c′ − c| |v| + |c| |v − x| for a term: v is the operand's value, x the
        exact one, c the coefficient and c′ its rounded value, the integer `whole` at the scale
        `fraction`.
        """
        used = math.ldexp(whole, self.builder[operand].fraction - fraction)
        off = share(used - coefficient, self.builder.reach(operand))
        return off + share(coefficient, self.builder.errors[operand])

    def _apart(self, terms: list[tuple[int, float]]) -> list[tuple[int, float]]:
        """The terms of a sum; those with general coefficients become one node if this gives their
        coefficients more bits.

        In x + dt · (…), the large first term would otherwise leave few bits for the coefficients of
        the second part.
        """
        products = [term for term in terms if self._exact_fraction(*term) is None]
        shifted = [term for term in terms if self._exact_fraction(*term) is not None]
        if not products or not shifted:
            return terms
        gained = self._largest_fraction(0.0, products) - self._largest_fraction(0.0, terms)
        if gained < _WORTH_A_SHIFT:
            return terms
        return [*shifted, (self._linear(0.0, products), 1.0)]

    def _constant(self, value: float) -> int:
        if value == 0.0:
            return self.builder.literal(0, 0)
        if not math.isfinite(value):
            raise CannotFitError("is not finite")
        # the mantissa fills the word; the rounding may carry into the next power of two
        fraction = self.builder.width.word - 1 - math.frexp(abs(value))[1]
        whole = round(math.ldexp(value, fraction))
        if abs(whole) > self.builder.width.largest_word:
            fraction -= 1
            whole = round(math.ldexp(value, fraction))
        return self.builder.literal(whole, fraction, abs(math.ldexp(whole, -fraction) - value))

    def _order(self, term: tuple[int, float]) -> tuple[int, int, int]:
        """Sort key of a term (node, coefficient) that keeps the ramps of a chain together in order.

        The bound of their sum requires this order.
        """
        ramp = self.ramps.get(term[0])
        return (0, 0, term[0]) if ramp is None else (1, ramp.chain, ramp.place)

    def _largest_fraction(self, constant: float, terms: list[tuple[int, float]]) -> int:
        low, high = self._bounds(terms, integer=False)
        # each product alone must fit as well as the sums: terms of opposite sign cancel only
        # afterwards
        products = [max(abs(v * c) for v in self.builder.bounds(node)) for node, c in terms]
        reach = max(abs(low), abs(high), *products) + abs(constant)
        if not math.isfinite(reach):
            raise CannotFitError("is not bounded")
        if reach == 0.0:
            return 0
        # rounded down: the largest value must fit, and _ROOM keeps what roundings add
        return math.floor(math.log2(_ROOM * self.builder.width.largest_sum / reach))

    def _fraction_of(self, constant: float, terms: list[tuple[int, float]]) -> int:
        """The fraction digits with which a constant is an integer, or if fewer, those of a word
        that holds the sum of the constant and the terms.
        """
        whole, parts = constant.as_integer_ratio()
        if not whole:
            return -_FINEST
        # a double is whole / parts with parts a power of two; trailing zeros of `whole` need no
        # bits
        twos = (whole & -whole).bit_length() - 1
        reach = max(map(abs, self._bounds(terms, integer=False))) + abs(constant)
        return min(
            parts.bit_length() - 1 - twos, self.builder.width.word - 1 - math.frexp(reach)[1]
        )

    def _bounds(self, terms: list[tuple[int, float]], *, integer: bool) -> tuple[float, float]:
        """The smallest and largest partial sum of the terms, 0 included; in integers or, for
        `integer` False, in real values.
        """
        low = high = 0
        chains: dict[int, list[float]] = {}
        for node, coefficient in terms:
            found = self.builder[node]
            ends = (found.low, found.high) if integer else self.builder.bounds(node)
            ramp = self.ramps.get(node)
            if ramp is None:
                values = [coefficient * end for end in ends]
                low, high = low + min(0, *values), high + max(0, *values)
            else:
                chains.setdefault(ramp.chain, [0]).append(coefficient * ends[1])
        for steps in chains.values():
            # one ramp of a chain moves at a time, so that the extremes are where intervals meet
            sums = [sum(steps[: count + 1]) for count in range(len(steps))]
            low, high = low + min(sums), high + max(sums)
        return low, high

    def _exact_fraction(self, node: int, coefficient: float) -> int | None:
        """The fraction digits with which coefficient · node is the node's own integer; None unless
        the coefficient is ± a power of two.
        """
        mantissa, exponent = math.frexp(abs(coefficient))
        return self.builder[node].fraction - (exponent - 1) if mantissa == 0.5 else None

    def _scaled(self, node: int, coefficient: float, fraction: int) -> tuple[int, int]:
        """The integer coefficient and the operand node of a term, if the sum has these fraction
        digits.
        """
        exact = self._exact_fraction(node, coefficient)
        sign = 1 if coefficient > 0 else -1
        # a power of two costs no multiplication: the node is shifted, up here or down below
        if exact is not None and fraction >= exact:
            return sign * 2 ** (fraction - exact), node
        if exact is not None:
            # a finer word is rounded first, then taken once: the sign is the whole coefficient
            shifted = self.builder.to_fraction(node, self.builder[node].fraction - exact + fraction)
            return sign, shifted
        word = self.builder.as_word(node)
        return round(math.ldexp(coefficient, fraction - self.builder[word].fraction)), word
