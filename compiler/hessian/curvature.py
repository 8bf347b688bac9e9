"""Adds the nodes of the Hessian of λᵀf: sums the contributions of all operations of a step f with
multipliers λ.

An operation y = φ(a, b, …) has the adjoint ȳ = ∂(λᵀf)/∂y. For directions i and j its contribution
is Σ ȳ (φ_aa ȧᵢ ȧⱼ + φ_ab (ȧᵢ ḃⱼ + ḃᵢ ȧⱼ) + φ_bb ḃᵢ ḃⱼ) over its elements. φ_aa, … are second
derivatives, ȧᵢ, … tangents. Linear operations contribute nothing. A product with a factor 0 is 0,
even if another is infinite (`slope_product`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from compiler.differentiation.reverse_mode import gradients
from compiler.ir import ops
from compiler.ir.builder import GraphBuilder
from compiler.ir.program import Graph, Node, NodeId
from compiler.ir.scalars import SCALAR_FUNCTIONS
from compiler.ir.slopes import slope_product, slope_quotient
from compiler.ir.types import Axis, in_order
from compiler.jacobian.matrices import Member


@dataclass(frozen=True, slots=True)
class DirectionRun:
    """Directions start … stop−1 of a group, and their place in the matrix: columns `column`,
    column+1, ….
    """

    start: int
    stop: int
    column: int


@dataclass(frozen=True, slots=True)
class Directions:
    """A group of variables whose elements, one variable after the other, are the directions along
    one axis of tangents.
    """

    axis: Axis
    members: tuple[Member, ...]

    def seeds(
        self, builder: GraphBuilder, leaves: Mapping[str, Sequence[NodeId]]
    ) -> dict[NodeId, NodeId]:
        """The tangents of the nodes that read the variables, by node: a unit direction per element.
        `leaves` has these nodes by variable name.
        """
        found: dict[NodeId, NodeId] = {}
        first = 0
        for member in self.members:
            # columns of the identity: the directions of the member's own elements
            values = np.eye(self.axis.size)[:, first : first + member.size]
            for leaf in leaves[member.name]:
                axes = (self.axis, *builder.type(leaf).axes)
                found[leaf] = builder.constant(values, axes, unit=None)
            first += member.size
        return found

    @property
    def runs(self) -> list[DirectionRun]:
        """The places of the directions in the matrix, as the smallest number of runs of adjacent
        columns.
        """
        runs: list[DirectionRun] = []
        for member in self.members:
            start = runs[-1].stop if runs else 0
            stop = start + member.size
            # extend the run if the next column is adjacent in the matrix
            if runs and runs[-1].column + start - runs[-1].start == member.first:
                runs[-1] = DirectionRun(runs[-1].start, stop, runs[-1].column)
            else:
                runs.append(DirectionRun(start, stop, member.first))
        return runs


def grouped_directions(
    graph: Graph, members: Sequence[Member], leaves: Mapping[str, Sequence[NodeId]]
) -> list[Directions]:
    """Groups the variables `members` that the graph reads: those that affect the same nonlinear
    operations share one axis of directions.

    `leaves` maps the name of a variable to the nodes that read it.
    """
    read = [member for member in members if leaves.get(member.name)]
    # sets of variables as bits of an integer, for fast unions over thousands of nodes
    bits = {leaf: 1 << i for i, member in enumerate(read) for leaf in leaves[member.name]}
    depends: list[int] = []
    decisive: list[int] = []
    for index, node in graph:
        of = [depends[arg] for arg in node.args]
        mask = bits.get(index, 0)
        for bit in of:
            mask |= bit
        depends.append(mask)
        # a contraction with one dependent operand is linear, but shares one product per group
        if mask and (bends(node, [bool(bit) for bit in of]) or isinstance(node.op, ops.Contract)):
            decisive.append(mask)
    groups: dict[tuple[int, ...], list[Member]] = {}
    for i, member in enumerate(read):
        # variables that affect the same operations have the same signature: their tangents are
        # nonzero together
        signature = tuple(place for place, mask in enumerate(decisive) if mask >> i & 1)
        groups.setdefault(signature, []).append(member)
    return [
        # axes of a spec have no quote in their names
        Directions(Axis(f"{i}'", sum(member.size for member in group)), tuple(group))
        for i, group in enumerate(groups.values())
    ]


def bends(node: Node, moving: Sequence[bool]) -> bool:
    """True if the operation is nonlinear in the operands with a flag in `moving`, those that depend
    on the variables; only then it has a second derivative.
    """
    match node.op:
        case ops.Multiply() | ops.Contract():
            return all(moving)
        # n/d is linear in n: it is nonlinear if d depends on the variables
        case ops.Divide():
            return moving[1]
        case ops.Apply():
            return any(moving)
        case _:
            return False


def second_slopes(builder: GraphBuilder, node: NodeId) -> dict[tuple[NodeId, NodeId], NodeId]:
    """The nodes of the second derivatives ∂²φ/∂a∂b of an `Apply` φ, by pairs (a, b) of its
    operands, each pair once, in the axes of the node. Absent ones are 0.

    If both operands are the same node, as in atan2(x, x), it is the second derivative of φ(x, x).
    The formula is differentiated with `Named` operands, which remain in the graph.
    """
    made = builder.node(node)
    assert isinstance(made.op, ops.Apply)
    explicit = SCALAR_FUNCTIONS[made.op.function].curvatures
    if explicit is None:
        found = _slopes_of_slopes(builder, made)
    else:
        found = _by_operands(builder, made, explicit(builder, made.args, node))
    for second in found.values():
        if builder.infinite_values.is_made_of_infinite(second):
            builder.infinite_values.expect(second)
    return found


def _by_operands(
    b: GraphBuilder, made: Node, known: tuple[NodeId, NodeId, NodeId]
) -> dict[tuple[NodeId, NodeId], NodeId]:
    left, right = made.args
    in_left, mixed, in_right = known
    if left == right:
        return {(left, left): b.add(b.add(in_left, b.add(mixed, mixed)), in_right)}
    return {(left, left): in_left, (left, right): mixed, (right, right): in_right}


def _slopes_of_slopes(b: GraphBuilder, made: Node) -> dict[tuple[NodeId, NodeId], NodeId]:
    operands = list(dict.fromkeys(made.args))
    # one operand may depend on the other: naming makes them independent variables
    # (names of a spec have no quote)
    held = {operand: b.named(operand, f"operand'{i}") for i, operand in enumerate(operands)}
    value = b.emit(made.op, tuple(held[arg] for arg in made.args), made.type)
    one = b.broadcast(b.constant(1.0), made.type.axes)
    firsts = gradients(b, {value: one}, list(held.values()))
    found: dict[tuple[NodeId, NodeId], NodeId] = {}
    for i, first in enumerate(firsts):
        # second derivatives are symmetric: each pair once, starting at the diagonal
        others = operands[i:]
        wanted = [held[other] for other in others]
        seconds = [None] * len(wanted) if first is None else gradients(b, {first: one}, wanted)
        for other, second in zip(others, seconds, strict=True):
            if second is not None:
                found[operands[i], other] = second
    return found


Tangents = Mapping[NodeId, NodeId]
"""Tangents of the nodes that depend on the directions of one group, axes (directions, *axes)."""


def curvatures(
    builder: GraphBuilder,
    adjoints: Mapping[NodeId, NodeId],
    groups: Sequence[tuple[Directions, Tangents]],
) -> dict[tuple[int, int], NodeId]:
    """The nodes of the blocks (directions of group g, of group h) of the Hessian, by group indices
    g ≤ h; absent blocks are 0.

    `adjoints` are those of the nonlinear nodes, `groups` the directions with the tangents of all
    nodes.
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
    """The nodes among the first `count` that can have nonzero second derivatives. `groups` has the
    tangents of the nodes for each group of directions.
    """
    # nodes that depend on no direction have no derivatives
    moving = [any(node in tangents for tangents in groups) for node in range(count)]
    return [
        node
        for node in range(count)
        if moving[node] and bends(builder.node(node), [moving[a] for a in builder.node(node).args])
    ]


@dataclass(frozen=True, slots=True)
class _Term:
    """One term of the Hessian, for an operation `node`: Σ weight · (tangent of `left` · tangent of
    `right`), plus the same with both exchanged if they differ.

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
    """Accumulates the terms of one block of the Hessian, with the directions `first` as rows and
    `second` as columns.
    """

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
        """Σ weight · left · right over all axes except the directions, for the tangents `left` and
        `right` of the term's operands. None if one is None: the operand does not depend on the
        directions.
        """
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
    """The node of left · right, summed over all axes except `kept`, with the axes in the order of
    `kept`.
    """
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
