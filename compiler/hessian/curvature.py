"""Sums the contributions of the operations of a step to the Hessian of λᵀf.

An operation y = φ(a, b, …) has the adjoint ȳ = ∂(λᵀf)/∂y. For directions i and j its contribution
is Σ ȳ (φ_aa ȧᵢ ȧⱼ + φ_ab (ȧᵢ ḃⱼ + ḃᵢ ȧⱼ) + φ_bb ḃᵢ ḃⱼ) over its elements. Linear operations
contribute nothing. A product with a factor 0 is 0, even if another is infinite (`slope_product`).
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
"""Tangents of the nodes that depend on the directions of one group, axes (directions, *axes)."""


def curvatures(
    builder: GraphBuilder,
    adjoints: Mapping[NodeId, NodeId],
    groups: Sequence[tuple[Directions, Tangents]],
) -> dict[tuple[int, int], NodeId]:
    """The blocks (directions of g, of h) of the Hessian, by group indices g ≤ h; absent blocks are
    0.

    `adjoints` are those of the nonlinear nodes.
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
    """The nodes among the first `count` that can have nonzero second derivatives."""
    # nodes that depend on no direction have no derivatives
    moving = [any(node in tangents for tangents in groups) for node in range(count)]
    return [
        node
        for node in range(count)
        if moving[node] and bends(builder.node(node), [moving[a] for a in builder.node(node).args])
    ]


@dataclass(frozen=True, slots=True)
class _Term:
    """Σ weight · (left tangent · right tangent), plus the term with both exchanged if they differ.

    For a `Contract` over `axis` the weight has the axes of the result; otherwise all axes are
    equal.
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
            # x² has the second derivative 2: with equal operands there is one term, counted twice
            weight = b.add(adjoint, adjoint) if left == right else adjoint
            yield _Term(node, weight, left, right)
        case ops.Divide():
            # n = y·d is linear: 0 = ÿ·d + 2·ẏ·ḋ
            divisor = made.args[1]
            # ÿ = −2·ẏ·ḋ/d; the factor 2 comes from both orders of the tangents
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
    """Accumulates a block of the Hessian."""

    def __init__(self, builder: GraphBuilder, first: Directions, second: Directions) -> None:
        self._b = builder
        self._rows = first.axis
        self._is_diagonal = first is second
        # rows and columns can have the same directions: a quote distinguishes the two axes
        self._columns = Axis(f"{second.axis.name}'", second.axis.size)
        self._squares: NodeId | None = None
        """Terms of one operand, symmetric up to rounding."""
        self._products: NodeId | None = None
        """Terms of two operands; in a diagonal block without their transpose."""

    def add(self, term: _Term, rows: Tangents, columns: Tangents) -> None:
        if term.left == term.right:
            product = self._summed(term, rows.get(term.left), columns.get(term.right))
            self._squares = self._sum(self._squares, product)
            return
        product = self._summed(term, rows.get(term.left), columns.get(term.right))
        self._products = self._sum(self._products, product)
        # in an off-diagonal block both orders are different entries; a diagonal block adds the
        # transpose in `total`
        if not self._is_diagonal:
            product = self._summed(term, rows.get(term.right), columns.get(term.left))
            self._products = self._sum(self._products, product)

    def total(self) -> NodeId | None:
        b = self._b
        if not self._is_diagonal:
            return self._sum(self._squares, self._products)
        squares = self._squares
        # a 1×1 block is its own transpose: twice the product, squares are not halved
        if self._rows.size == 1:
            return self._sum(squares, self._sum(self._products, self._products))
        # half of it plus its transpose: both triangles are bit-identical
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
        """Σ over all axes except the directions."""
        if left is None or right is None:
            return None
        b = self._b
        # renamed with a quote, since both tangents may belong to one group
        right = b.reshape(right, (self._columns, *b.type(right).axes[1:]))
        # one tangent after the other: a product of all three would have all axes
        weighted = _contracted(b, term.weight, left, (self._rows, *b.type(right).axes[1:]))
        return _contracted(b, weighted, right, (self._rows, self._columns))


def _product(b: GraphBuilder, first: NodeId, second: NodeId) -> NodeId:
    product = slope_product(b, first, second)
    if b.infinite_values.is_made_of_infinite(product):
        # a factor 0 may still follow
        b.infinite_values.expect(product)
    return product


def _contracted(b: GraphBuilder, left: NodeId, right: NodeId, kept: tuple[Axis, ...]) -> NodeId:
    """Σ of the product over all axes except `kept`, in the order of `kept`."""
    names = {axis.name for axis in kept}
    mine, others = b.type(left).axes, b.type(right).axes
    shared = [a.name for a in mine if a.name not in names and a in others]
    infinite = b.infinite_values.is_made_of_infinite
    # a sum of products over a shared axis is a contraction, which backends compute in a loop
    if shared and not (infinite(left) or infinite(right)):
        product = b.contract_over(left, right, shared[-1])
    else:
        # a contraction does not test its factors for 0
        whole = in_order((*mine, *(axis for axis in others if axis not in mine)))
        product = _product(b, b.broadcast(left, whole), b.broadcast(right, whole))
    for axis in reversed(b.type(product).axes):
        if axis.name not in names:
            product = b.sum(product, axis.name)
    return b.broadcast(product, kept)
