"""Builds integer nodes with the bounds of their values; what could overflow is never built."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

from compiler.fixed_point.integers.program import (
    Choose,
    IntegerNode,
    IntegerOp,
    Larger,
    Literal,
    Lookup,
    Product,
    ReadMemory,
    ReadWord,
    RoundShift,
    Smaller,
    WeightedSum,
    Width,
)
from compiler.ir.ops import Relation
from spec_schema.diagnostics.source import Span


class CannotFitError(Exception):
    """No scale keeps a value within its bits; the text says why."""


class IntegerBuilder:
    """A growing list of nodes; equal ones are shared."""

    def __init__(self, width: Width) -> None:
        self.width = width
        self.nodes: list[IntegerNode] = []
        self.span: Span | None = None
        self._known: dict[tuple[IntegerOp, tuple[int, ...], int], int] = {}

    def __getitem__(self, node: int) -> IntegerNode:
        return self.nodes[node]

    def bounds(self, node: int) -> tuple[float, float]:
        """The real numbers that a node can stand for."""
        found = self.nodes[node]
        return math.ldexp(found.low, -found.fraction), math.ldexp(found.high, -found.fraction)

    def literal(self, value: int, fraction: int) -> int:
        return self._emit(Literal(value), (), fraction, value, value)

    def word(self, port: str, index: int, fraction: int, low: int, high: int) -> int:
        return self._emit(ReadWord(port, index), (), fraction, low, high)

    def memory(self, name: str, index: int, fraction: int, low: int, high: int) -> int:
        return self._emit(ReadMemory(name, index), (), fraction, low, high)

    def weighted_sum(
        self,
        constant: int,
        terms: Sequence[tuple[int, int]],
        fraction: int,
        bounds: tuple[int, int],
    ) -> int:
        """constant + Σ coefficient · node, with bounds that the caller has proved."""
        coefficients = tuple(coefficient for coefficient, _ in terms)
        args = tuple(node for _, node in terms)
        if constant == 0 and coefficients == (1,) and self[args[0]].fraction == fraction:
            return args[0]
        return self._emit(WeightedSum(constant, coefficients), args, fraction, *bounds)

    def product(self, left: int, right: int) -> int:
        """a · b; both must be words."""
        a, b = self[left], self[right]
        corners = [x * y for x in (a.low, a.high) for y in (b.low, b.high)]
        low = max(min(corners), 0) if left == right else min(corners)
        return self._emit(Product(), (left, right), a.fraction + b.fraction, low, max(corners))

    def to_fraction(self, node: int, fraction: int) -> int:
        """The value at another scale: rounded where that is coarser, exact where it is finer."""
        found = self[node]
        bits = found.fraction - fraction
        if bits == 0:
            return node
        if isinstance(found.op, Literal):
            return self.literal(_shifted(found.op.value, bits), fraction)
        if bits < 0:
            factor = 2**-bits
            scaled = (found.low * factor, found.high * factor)
            return self.weighted_sum(0, [(factor, node)], fraction, scaled)
        if bits > self.width.sum - 2:
            return self.literal(0, fraction)
        self._check(found.low + 2 ** (bits - 1), found.high + 2 ** (bits - 1))
        low, high = _shifted(found.low, bits), _shifted(found.high, bits)
        return self._emit(RoundShift(bits), (node,), fraction, low, high)

    def as_word(self, node: int) -> int:
        """The value with as many bits as a word has."""
        found = self[node]
        fraction = found.fraction
        limit = self.width.largest_word
        while max(_shifted(found.high, found.fraction - fraction), 0) > limit or (
            _shifted(found.low, found.fraction - fraction) < -limit
        ):
            fraction -= 1
        return self.to_fraction(node, fraction)

    def smaller(self, left: int, right: int) -> int:
        a, b = self[left], self[right]
        if a.high <= b.low:
            return left
        if b.high <= a.low:
            return right
        bounds = min(a.low, b.low), min(a.high, b.high)
        return self._emit(Smaller(), (left, right), a.fraction, *bounds)

    def larger(self, left: int, right: int) -> int:
        a, b = self[left], self[right]
        if a.low >= b.high:
            return left
        if b.low >= a.high:
            return right
        bounds = max(a.low, b.low), max(a.high, b.high)
        return self._emit(Larger(), (left, right), a.fraction, *bounds)

    def saturated(self, node: int, low: int, high: int) -> int:
        """The value moved to the nearest limit; nothing where it cannot be outside."""
        fraction = self[node].fraction
        node = self.larger(node, self.literal(low, fraction))
        return self.smaller(node, self.literal(high, fraction))

    def magnitude(self, node: int) -> int:
        """max(a, −a)."""
        found = self[node]
        negative = self.weighted_sum(0, [(-1, node)], found.fraction, (-found.high, -found.low))
        low = max(found.low, -found.high, 0)
        high = max(-found.low, found.high)
        return self._emit(Larger(), (node, negative), found.fraction, low, high)

    def choose(self, relation: Relation, left: int, right: int, then: int, otherwise: int) -> int:
        a, b = self[then], self[otherwise]
        if then == otherwise:
            return then
        bounds = min(a.low, b.low), max(a.high, b.high)
        args = left, right, then, otherwise
        return self._emit(Choose(relation), args, a.fraction, *bounds)

    def lookup(self, node: int, table: Lookup, fraction: int) -> int:
        widest = max(abs(b - a) for a, b in pairwise(table.values))
        self._check(0, widest * 2**table.bits + 2**table.bits)
        found = self[node]
        assert found.low >= table.first, "the table begins below"
        assert (found.high - table.first) >> table.bits < len(table.values) - 1, "and ends above"
        return self._emit(table, (node,), fraction, min(table.values), max(table.values))

    def _emit(
        self, op: IntegerOp, args: tuple[int, ...], fraction: int, low: int, high: int
    ) -> int:
        self._check(low, high)
        key = (op, args, fraction)
        if key not in self._known:
            self._known[key] = len(self.nodes)
            self.nodes.append(IntegerNode(op, args, fraction, low, high, self.span))
        return self._known[key]

    def _check(self, low: int, high: int) -> None:
        if max(-low, high) > self.width.largest_sum:
            raise CannotFitError(f"needs more than {self.width.sum} bits")


def _shifted(value: int, bits: int) -> int:
    """⌊value / 2^bits + 1/2⌋, exact for negative bits."""
    return value << -bits if bits <= 0 else (value + (1 << (bits - 1))) >> bits
