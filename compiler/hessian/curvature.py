"""Sums what the operations of a step add to the Hessian of λᵀf.

The operation y = φ(a, b, …) with adjoint ȳ = ∂(λᵀf)/∂y adds, for directions i and j,
Σ ȳ (φ_aa ȧᵢ ȧⱼ + φ_ab (ȧᵢ ḃⱼ + ḃᵢ ȧⱼ) + φ_bb ḃᵢ ḃⱼ), summed over its elements; linear ones add
nothing. A product with a factor 0 is 0, whichever it is (`slope_product`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from compiler.hessian.directions import Directions, bends
from compiler.hessian.second_slopes import second_slopes
from compiler.ir import ops
from compiler.ir.builder import GraphBuilder
from compiler.ir.program import NodeId
from compiler.ir.scalars.slope_products import slope_product, slope_quotient
from compiler.ir.types import Axis, in_order

Tangents = Mapping[NodeId, NodeId]
"""Of the nodes that depend on the directions of one group, (directions, *axes)."""


def curvatures(
    builder: GraphBuilder,
    adjoints: Mapping[NodeId, NodeId],
    groups: Sequence[tuple[Directions, Tangents]],
) -> dict[tuple[int, int], NodeId]:
    """The blocks (directions of g, of h) of the Hessian, by the numbers g ≤ h of the groups.

    `adjoints` are those of the nodes that bend. What is not there is 0.
    """
    found: dict[tuple[int, int], NodeId] = {}
    terms = [term for node, adjoint in adjoints.items() for term in _terms(builder, node, adjoint)]
    for g, (first, of_first) in enumerate(groups):
        # the Hessian is symmetric: blocks below the diagonal are mirrored
        for h in range(g, len(groups)):
            second, of_second = groups[h]
            block = _Block(builder, first, second)
            for term in terms:
                with builder.at(builder.node(term.node).span):
                    block.add(term, of_first, of_second)
            total = block.total()
            if total is not None:
                found[g, h] = total
    return found


def bending_nodes(builder: GraphBuilder, count: int, groups: Sequence[Tangents]) -> list[NodeId]:
    """The nodes among the first `count` that can have second slopes."""
    # a node between inputs and results: what no direction moves has no slope, let alone a second
    # one
    moving = [any(node in tangents for tangents in groups) for node in range(count)]
    return [
        node
        for node in range(count)
        if moving[node] and bends(builder.node(node), [moving[a] for a in builder.node(node).args])
    ]


@dataclass(frozen=True, slots=True)
class _Term:
    """Σ weight · (left tangent · right tangent), and the same with both exchanged if they differ.

    Of a `Contract` over `axis` the weight has the axes of the sum; otherwise all have the same.
    """

    node: NodeId
    weight: NodeId
    left: NodeId
    right: NodeId


def _terms(b: GraphBuilder, node: NodeId, adjoint: NodeId) -> Iterator[_Term]:
    made = b.node(node)
    match made.op:
        case ops.Multiply() | ops.Contract():
            left, right = made.args
            # x² has the second slope 2
            # with both operands the same there is one term, and it counts once for each of the two
            # orders
            weight = b.add(adjoint, adjoint) if left == right else adjoint
            yield _Term(node, weight, left, right)
        case ops.Divide():
            # n = y·d is linear: 0 = ÿ·d + 2·ẏ·ḋ
            divisor = made.args[1]
            # ÿ = −2·ẏ·ḋ/d; both orders of the two tangents make the 2
            weight = b.negate(slope_quotient(b, adjoint, divisor))
            infinite = b.infinite_values
            if infinite.is_made_of_infinite(weight) or not infinite.divides(divisor):
                infinite.expect(weight)
            yield _Term(node, weight, node, divisor)
        case ops.Apply():
            for (left, right), slope in second_slopes(b, node).items():
                yield _Term(node, _product(b, adjoint, slope), left, right)
        case _:
            raise AssertionError("other operations do not bend")


class _Block:
    """A block of the Hessian while it is summed."""

    def __init__(self, builder: GraphBuilder, first: Directions, second: Directions) -> None:
        self._b = builder
        self._rows = first.axis
        self._is_diagonal = first is second
        # the same directions once as rows and once as columns: a quote keeps the two axes apart
        self._columns = Axis(f"{second.axis.name}'", second.axis.size)
        self._squares: NodeId | None = None
        """Terms of one operand: symmetric as they are, but for rounding."""
        self._products: NodeId | None = None
        """Terms of two operands; in a block on the diagonal without their mirror image."""

    def add(self, term: _Term, rows: Tangents, columns: Tangents) -> None:
        if term.left == term.right:
            product = self._summed(term, rows.get(term.left), columns.get(term.right))
            self._squares = self._sum(self._squares, product)
            return
        product = self._summed(term, rows.get(term.left), columns.get(term.right))
        self._products = self._sum(self._products, product)
        # in a block off the diagonal the two orders are different entries; on it the mirror adds
        # the other
        if not self._is_diagonal:
            product = self._summed(term, rows.get(term.right), columns.get(term.left))
            self._products = self._sum(self._products, product)

    def total(self) -> NodeId | None:
        b = self._b
        if not self._is_diagonal:
            return self._sum(self._squares, self._products)
        squares = self._squares
        # one number is its own mirror image: twice the product, without halving and doubling
        # squares
        if self._rows.size == 1:
            return self._sum(squares, self._sum(self._products, self._products))
        # half of it and its mirror image: equal in both triangles to the bit
        half = None if squares is None else b.multiply(b.constant(0.5), squares)
        total = self._sum(half, self._products)
        return None if total is None else b.add(total, self._mirrored(total))

    def _mirrored(self, block: NodeId) -> NodeId:
        b = self._b
        renamed = b.reshape(block, (self._columns, self._rows))
        return b.broadcast(renamed, (self._rows, self._columns))

    def _sum(self, before: NodeId | None, more: NodeId | None) -> NodeId | None:
        if before is None or more is None:
            return more if before is None else before
        return self._b.add(before, more)

    def _summed(self, term: _Term, left: NodeId | None, right: NodeId | None) -> NodeId | None:
        """Σ over all axes but those of the directions."""
        if left is None or right is None:
            return None
        b = self._b
        # (directions, …) under the name with a quote: both tangents may be of one group
        right = b.reshape(right, (self._columns, *b.type(right).axes[1:]))
        # one tangent after the other: the product of both with the weight would have the axes of
        # all
        weighted = _contracted(b, term.weight, left, (self._rows, *b.type(right).axes[1:]))
        return _contracted(b, weighted, right, (self._rows, self._columns))


def _product(b: GraphBuilder, first: NodeId, second: NodeId) -> NodeId:
    product = slope_product(b, first, second)
    if b.infinite_values.is_made_of_infinite(product):
        # a factor 0 may still come after it
        b.infinite_values.expect(product)
    return product


def _contracted(b: GraphBuilder, left: NodeId, right: NodeId, kept: tuple[Axis, ...]) -> NodeId:
    """Σ over every axis that is not kept of the product, in the order of `kept`."""
    names = {axis.name for axis in kept}
    mine, others = b.type(left).axes, b.type(right).axes
    shared = [a.name for a in mine if a.name not in names and a in others]
    infinite = b.infinite_values.is_made_of_infinite
    # over a shared axis the sum of products is one contraction, which backends have a loop for
    if shared and not (infinite(left) or infinite(right)):
        product = b.contract_over(left, right, shared[-1])
    else:
        # a sum of products looks at no factor
        whole = in_order((*mine, *(axis for axis in others if axis not in mine)))
        product = _product(b, b.broadcast(left, whole), b.broadcast(right, whole))
    for axis in reversed(b.type(product).axes):
        if axis.name not in names:
            product = b.sum(product, axis.name)
    return b.broadcast(product, kept)
