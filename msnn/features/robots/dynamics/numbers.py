"""Calculates with constants and scalar graph nodes; operations on constants are folded."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeAlias

from compiler.ir import ops
from compiler.ir.builder import GraphBuilder
from compiler.ir.program import NodeId
from compiler.ir.types import Type


@dataclass(frozen=True, slots=True, eq=False)
class SignedNode:
    """The value of a scalar node without unit, or its negative; sums absorb the sign, so it needs
    no operation.

    Sums with 0 and products with 0, 1 and −1 add no operation.
    """

    builder: GraphBuilder
    node: NodeId
    is_negative: bool = False

    def __neg__(self) -> Number:
        return replace(self, is_negative=not self.is_negative)

    def __add__(self, other: Number) -> Number:
        if not isinstance(other, SignedNode):
            if other == 0.0:
                return self
            other = SignedNode(self.builder, self.builder.constant(other, unit=None))
        # −a − b is −(a + b): the sign waits for a sum that can take it as a subtraction
        if self.is_negative and other.is_negative:
            return -self._made(ops.Add(), self.node, other.node)
        if self.is_negative:
            return self._made(ops.Subtract(), other.node, self.node)
        operation = ops.Subtract() if other.is_negative else ops.Add()
        return self._made(operation, self.node, other.node)

    def __radd__(self, other: float) -> Number:
        return self + other

    def __sub__(self, other: Number) -> Number:
        return self + -other

    def __rsub__(self, other: float) -> Number:
        return -self + other

    def __mul__(self, other: Number) -> Number:
        if not isinstance(other, SignedNode):
            # such numbers are geometry: 0 · ∞ is 0 here, as the product is none
            if other in (0.0, 1.0, -1.0):
                return 0.0 if other == 0.0 else self if other == 1.0 else -self
            size = self.builder.constant(abs(other), unit=None)
            other = SignedNode(self.builder, size, other < 0.0)
        # a·b and b·a are one node
        result = self._made(ops.Multiply(), *sorted((self.node, other.node)))
        return result if self.is_negative == other.is_negative else -result

    def __rmul__(self, other: float) -> Number:
        return self * other

    def __truediv__(self, other: Number) -> Number:
        if not isinstance(other, SignedNode):
            return self * (1.0 / other)
        result = self._made(ops.Divide(), self.node, other.node)
        return result if self.is_negative == other.is_negative else -result

    def __rtruediv__(self, other: float) -> Number:
        if other == 0.0:
            return 0.0
        return SignedNode(self.builder, self.builder.constant(other, unit=None)) / self

    def applied(self, function: str) -> Number:
        """The scalar function `cos` or `sin` of the value."""
        made = ops.Apply(function)
        result = SignedNode(self.builder, self.builder.emit(made, (self.node,), self._type()))
        # sine is odd and cosine even: the sign of an argument costs no operation
        return -result if self.is_negative and function == "sin" else result

    def as_node(self) -> NodeId:
        """A node with this value; a negative sign becomes an operation."""
        if not self.is_negative:
            return self.node
        return self.builder.emit(ops.Negate(), (self.node,), self._type())

    def _type(self) -> Type:
        return self.builder.type(self.node).with_unit(None)

    def _made(self, operation: ops.Op, left: NodeId, right: NodeId) -> SignedNode:
        left, right, axes = self.builder.aligned(left, right)
        return SignedNode(
            self.builder, self.builder.emit(operation, (left, right), Type(axes, None))
        )


Number: TypeAlias = float | SignedNode
Triple: TypeAlias = tuple[Number, Number, Number]
Rows: TypeAlias = tuple[Triple, Triple, Triple]

NOTHING: Triple = (0.0, 0.0, 0.0)


def dot(a: Triple, b: Triple) -> Number:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Triple, b: Triple) -> Triple:
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


def plus(a: Triple, b: Triple) -> Triple:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def scaled(factor: Number, a: Triple) -> Triple:
    return factor * a[0], factor * a[1], factor * a[2]


def times(A: Rows, b: Triple) -> Triple:
    """The product A b of a matrix and a vector."""
    return dot(A[0], b), dot(A[1], b), dot(A[2], b)


def transposed(A: Rows) -> Rows:
    a, b, c = zip(*A, strict=True)
    return a, b, c


def sum_of(A: Rows, B: Rows) -> Rows:
    return plus(A[0], B[0]), plus(A[1], B[1]), plus(A[2], B[2])


def congruent(R: Rows, S: Rows) -> Rows:
    """The matrix R S Rᵀ for a symmetric S; equal elements are computed once."""
    half = times(S, R[0]), times(S, R[1]), times(S, R[2])
    return symmetric(
        *(dot(R[i], half[j]) for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)))
    )


def symmetric(xx: Number, xy: Number, xz: Number, yy: Number, yz: Number, zz: Number) -> Rows:
    """The symmetric matrix with these elements."""
    return ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz))
