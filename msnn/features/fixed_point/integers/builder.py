"""Builds integer nodes with bounds of their values; raises an error if one could overflow."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

from compiler.ir.ops import Relation
from msnn.features.fixed_point.integers import program as integer
from spec_schema.diagnostics.source import Span


class CannotFitError(Exception):
    """No scale represents a value with the available bits; the text says why."""


class IntegerBuilder:
    """Builds a list of nodes, which are identified by their index; equal nodes are shared. Raises
    CannotFitError for a node that could overflow.

    `errors` bounds the error of each node against the real value, if the words and memories that it
    reads are exact (decision 0193). A shared node has the largest of its bounds.
    """

    def __init__(self, width: integer.Width) -> None:
        self.width = width
        self.nodes: list[integer.IntegerNode] = []
        self.errors: list[float] = []
        self.span: Span | None = None
        self._known: dict[tuple[integer.IntegerOp, tuple[int, ...], int], int] = {}

    def __getitem__(self, node: int) -> integer.IntegerNode:
        return self.nodes[node]

    def bounds(self, node: int) -> tuple[float, float]:
        """The smallest and largest real value of a node."""
        found = self.nodes[node]
        return math.ldexp(found.low, -found.fraction), math.ldexp(found.high, -found.fraction)

    def reach(self, node: int) -> float:
        """The largest magnitude of a node's real value."""
        return max(map(abs, self.bounds(node)))

    def allow(self, node: int, error: float) -> int:
        """Raises the error bound of a node to at least `error`, and returns the node."""
        self.errors[node] = max(self.errors[node], error)
        return node

    def literal(self, value: int, fraction: int, error: float = 0.0) -> int:
        return self.allow(self._emit(integer.Literal(value), (), fraction, value, value), error)

    def word(self, port: str, index: int, fraction: int, low: int, high: int) -> int:
        return self._emit(integer.ReadWord(port, index), (), fraction, low, high)

    def memory(self, name: str, index: int, fraction: int, low: int, high: int) -> int:
        return self._emit(integer.ReadMemory(name, index), (), fraction, low, high)

    def weighted_sum(
        self,
        constant: int,
        terms: Sequence[tuple[int, int]],
        fraction: int,
        bounds: tuple[int, int],
    ) -> int:
        """The node of constant + Σ coefficient · node, for `terms` of (coefficient, node).

        All are integers. `constant`, the result and each product are numbers times 2^`fraction`;
        nothing is shifted. The caller has proved that the result lies in
        `bounds`. A single term with coefficient 1 is its own node. Raises CannotFitError if a sum
        exceeds the widest word.
        """
        coefficients = tuple(coefficient for coefficient, _ in terms)
        args = tuple(node for _, node in terms)
        # a copy: no operation, and what is known of the node stays known
        if constant == 0 and coefficients == (1,) and self[args[0]].fraction == fraction:
            return args[0]
        return self._emit(integer.WeightedSum(constant, coefficients), args, fraction, *bounds)

    def product(self, left: int, right: int, most: float = math.inf) -> int:
        """left · right; both must be words. `most` is an error bound that the caller has proved;
        the smaller one counts.
        """
        a, b = self[left], self[right]
        corners = [x * y for x in (a.low, a.high) for y in (b.low, b.high)]
        # a square is never negative, which the corners of two intervals do not show
        low = max(min(corners), 0) if left == right else min(corners)
        fraction = a.fraction + b.fraction
        node = self._emit(integer.Product(), (left, right), fraction, low, max(corners))
        error, other = self.errors[left], self.errors[right]
        # ab − AB = a (b − B) + b (a − A) − (a − A)(b − B)
        sides = share(self.reach(left), other) + share(self.reach(right) + other, error)
        return self.allow(node, min(sides, most))

    def to_fraction(self, node: int, fraction: int) -> int:
        """The node's value at another scale: rounded with fewer fraction digits, exact
        with more.
        """
        found, error = self[node], self.errors[node]
        bits = found.fraction - fraction
        if bits == 0:
            return node
        # a literal is rounded here, so that no step shifts it
        if isinstance(found.op, integer.Literal):
            moved = _shifted(found.op.value, bits)
            lost = abs(math.ldexp(moved, -fraction) - math.ldexp(found.op.value, -found.fraction))
            return self.literal(moved, fraction, error + lost)
        # to a finer scale is a product with a power of 2, exact if it fits
        if bits < 0:
            factor = 2**-bits
            scaled = (found.low * factor, found.high * factor)
            return self.allow(self.weighted_sum(0, [(factor, node)], fraction, scaled), error)
        # such a shift would leave at most one unit; 0 is off by all that the value can be
        if bits > self.width.sum - 2:
            return self.literal(0, fraction, error + self.reach(node))
        # half a unit is added before the shift, and that sum must fit too
        self._check(found.low + 2 ** (bits - 1), found.high + 2 ** (bits - 1))
        low, high = _shifted(found.low, bits), _shifted(found.high, bits)
        rounded = self._emit(integer.RoundShift(bits), (node,), fraction, low, high)
        # to nearest: half a unit of the new scale
        return self.allow(rounded, error + math.ldexp(0.5, -fraction))

    def as_word(self, node: int) -> int:
        """The node's value at the finest scale, not finer than its own, at which it fits a word."""
        found = self[node]
        fraction = found.fraction
        limit = self.width.largest_word
        # words are symmetric: −2^(n−1) is none, so that every word can be negated
        while max(_shifted(found.high, found.fraction - fraction), 0) > limit or (
            _shifted(found.low, found.fraction - fraction) < -limit
        ):
            fraction -= 1
        return self.to_fraction(node, fraction)

    def smaller(self, left: int, right: int) -> int:
        a, b = self[left], self[right]
        # decided by the bounds: no node, and the result keeps the narrower bounds
        if a.high <= b.low:
            return self._decided(left, right, b.low - a.high)
        if b.high <= a.low:
            return self._decided(right, left, a.low - b.high)
        # min and max move no farther than the operand that moves most
        error = max(self.errors[left], self.errors[right])
        bounds = min(a.low, b.low), min(a.high, b.high)
        return self.allow(self._emit(integer.Smaller(), (left, right), a.fraction, *bounds), error)

    def larger(self, left: int, right: int) -> int:
        a, b = self[left], self[right]
        if a.low >= b.high:
            return self._decided(left, right, a.low - b.high)
        if b.low >= a.high:
            return self._decided(right, left, b.low - a.high)
        error = max(self.errors[left], self.errors[right])
        bounds = max(a.low, b.low), max(a.high, b.high)
        return self.allow(self._emit(integer.Larger(), (left, right), a.fraction, *bounds), error)

    def _decided(self, taken: int, other: int, apart: int) -> int:
        """The minimum or maximum `taken` of two nodes that bounds decide; they are at least `apart`
        units apart.

        The exact value of the other node may pass the result by its own error minus that distance.
        """
        passed = self.errors[other] - math.ldexp(apart, -self[taken].fraction)
        return self.allow(taken, passed)

    def saturated(self, node: int, low: int, high: int) -> int:
        """The value limited to low … high; no node is added if it cannot be outside."""
        fraction = self[node].fraction
        node = self.larger(node, self.literal(low, fraction))
        return self.smaller(node, self.literal(high, fraction))

    def magnitude(self, node: int) -> int:
        """The absolute value of a node, as max(a, −a)."""
        found = self[node]
        negative = self.weighted_sum(0, [(-1, node)], found.fraction, (-found.high, -found.low))
        low = max(found.low, -found.high, 0)
        high = max(-found.low, found.high)
        size = self._emit(integer.Larger(), (node, negative), found.fraction, low, high)
        return self.allow(size, self.errors[node])

    def choose(
        self,
        relation: Relation,
        left: int,
        right: int,
        then: int,
        otherwise: int,
        apart: float = math.inf,
    ) -> int:
        """`then` if left relation right, else `otherwise`; all are nodes, the last two of the same
        scale.

        `apart` bounds the difference of the two choices where the exact values of left and right
        compare differently than the nodes.
        """
        a, b = self[then], self[otherwise]
        if then == otherwise:
            return then
        bounds = min(a.low, b.low), max(a.high, b.high)
        args = left, right, then, otherwise
        error = max(self.errors[then], self.errors[otherwise])
        if self.is_doubtful(left, right):  # the exact values may choose the other one
            widest = math.ldexp(max(a.high - b.low, b.high - a.low), -a.fraction)
            error += min(widest, apart)
        return self.allow(self._emit(integer.Choose(relation), args, a.fraction, *bounds), error)

    def is_doubtful(self, left: int, right: int) -> bool:
        """True if the exact values of two nodes may compare differently than the nodes."""
        error = self.errors[left] + self.errors[right]
        (a, b), (c, d) = self.bounds(left), self.bounds(right)
        # the sides can come as close as both errors together
        return error > 0.0 and max(a - d, c - b) <= error

    def lookup(self, node: int, table: integer.IntegerLookup, fraction: int) -> int:
        widest = max(abs(b - a) for a, b in pairwise(table.values))
        # interpolation multiplies a step of the table by a distance below 2^bits, and adds half a
        # unit to round
        self._check(0, widest * (2**table.bits - 1) + 2**table.bits // 2)
        found = self[node]
        assert found.low >= table.first, "the table begins below"
        assert (found.high - table.first) >> table.bits < len(table.values) - 1, "and ends above"
        return self._emit(table, (node,), fraction, min(table.values), max(table.values))

    def _emit(
        self, op: integer.IntegerOp, args: tuple[int, ...], fraction: int, low: int, high: int
    ) -> int:
        self._check(low, high)
        # Bounds are no part of the key: equal operations on equal nodes have one value, and any
        # bounds proved for it hold.
        key = (op, args, fraction)
        if key not in self._known:
            self._known[key] = len(self.nodes)
            self.nodes.append(
                integer.IntegerNode(
                    op=op, args=args, fraction=fraction, low=low, high=high, span=self.span
                )
            )
            self.errors.append(0.0)
        return self._known[key]

    def _check(self, low: int, high: int) -> None:
        if max(-low, high) > self.width.largest_sum:
            raise CannotFitError(f"needs more than {self.width.sum} bits")


def share(factor: float, error: float) -> float:
    """|factor| · error; 0 if either is 0, even if the other is infinite."""
    return abs(factor) * error if factor and error else 0.0


def _shifted(value: int, bits: int) -> int:
    """⌊value / 2^bits + 1/2⌋, exact for negative bits."""
    return value << -bits if bits <= 0 else (value + (1 << (bits - 1))) >> bits
