"""Keeps derivatives finite for autodiff libraries, which evaluate 0 · ∞ as NaN."""

from __future__ import annotations

import math
from collections.abc import Callable

from compiler.ir.builder import GraphBuilder
from compiler.ir.graph_copy import copy_node, with_start, with_step
from compiler.ir.ops import Apply, Divide, Relation, Select
from compiler.ir.program import Graph, Node, NodeId, Program
from compiler.passes.derivatives.guard_untaken import SAFE

STEEP = 1e30
"""Replaces an infinite derivative; finite in single precision too, so that 0 times it is 0."""


def guard_infinite_slopes(program: Program) -> Program:
    """Gives √, log, pow, asin, acos and ÷ a harmless argument where their derivative is infinite.

    Before: any form. After: the same values. The replacement has the same value and the derivative
    `STEEP`. A product of derivatives with a factor 0 is then 0 in torch and CasADi too, as in
    reverse mode (`slope_product`). A quotient by 0 has this derivative in its divisor only.

        sqrt(x)
        where(abs(x) <= 0, 1e30 * x, sqrt(where(abs(x) <= 0, 0.5, x)))
    """
    program = with_step(program, *_guarded(program.step))
    return with_start(program, *_guarded(program.start))


def _guarded(graph: Graph) -> tuple[Graph, dict[NodeId, NodeId]]:
    builder = GraphBuilder()
    copies: dict[NodeId, NodeId] = {}
    for index, node in graph:
        args = tuple(copies[arg] for arg in node.args)
        with builder.at(node.span):
            made = _Guard(builder, node, args).result()
        copies[index] = copy_node(builder, node, args) if made is None else made
        # the replacement keeps the label
        if node.label is not None:
            builder.name(copies[index], node.label)
    return builder.graph(), copies


class _Guard:
    """One operation and its operands."""

    def __init__(self, builder: GraphBuilder, node: Node, args: tuple[NodeId, ...]) -> None:
        self._b, self._node, self._args = builder, node, args

    def result(self) -> NodeId | None:
        """The node that replaces the operation; None if its derivatives are finite."""
        b, args = self._b, self._args
        # x² + 1, for example, is structurally nonzero and needs no guard
        never_zero = b.infinite_values.is_never_zero
        match self._node.op:
            case Divide() if not b.infinite_values.divides(args[1]):
                return self._split(1, self._is_zero(args[1]), self._quotient)
            case Apply("sqrt") if not never_zero(args[0]):
                return self._split(0, self._is_zero(args[0]), lambda: self._steep(args[0]))
            case Apply("log") if not never_zero(args[0]):
                return self._split(
                    0,
                    self._is_zero(args[0]),
                    lambda: b.add(self._number(-math.inf), self._steep(args[0])),
                )
            case Apply("pow") if not never_zero(args[0]):
                return self._split(0, self._is_zero(args[0]), self._power)
            case Apply("asin" | "acos"):
                # exact near 1 (Sterbenz lemma)
                edge = b.subtract(self._number(1.0), b.apply("abs", args[0]))
                return self._split(0, self._is_zero(edge), self._arc)
            case _:
                return None

    def _split(self, position: int, there: NodeId, value: Callable[[], NodeId]) -> NodeId:
        """`value()` where `there` holds, the operation elsewhere."""
        # the operation gets a harmless operand, since libraries differentiate both branches
        b, args = self._b, list(self._args)
        type = b.type(args[position])
        args[position] = b.emit(Select(), (there, self._number(SAFE), args[position]), type)
        usual = b.emit(self._node.op, tuple(args), self._node.type)
        return b.emit(Select(), (there, value(), usual), self._node.type)

    def _quotient(self) -> NodeId:
        """±∞ with the sign of the quotient, NaN for 0/0 and NaN."""
        b, (above, below) = self._b, self._args
        # comparisons cannot distinguish −0 from 0, but 1/−0 is −∞
        sign_of_zero = self._is_positive(b.divide(self._number(1.0), below))
        infinity = self._chosen(sign_of_zero, math.inf, -math.inf)
        # 1/x decreases on both sides of 0
        falling = b.negate(self._steep(below))
        positive = b.add(infinity, falling)
        negative = b.negate(positive)
        known = b.select(
            b.compare(Relation.LESS, above, self._number(0.0)), negative, self._number(math.nan)
        )
        # NaN is neither positive nor negative: 0/0 and NaN give NaN
        return b.select(self._is_positive(above), positive, known)

    def _power(self) -> NodeId:
        """0ʸ: `STEEP` for 0 < y < 1, the base for y = 1, 0 above; 0⁰ is 1 and decreases with y."""
        b, (base, exponent) = self._b, self._args
        zero, one = self._number(0.0), self._number(1.0)
        below_zero = b.compare(Relation.LESS, exponent, zero)
        pole = b.subtract(self._number(math.inf), self._steep(base))
        flat = b.select(b.compare(Relation.LESS_EQUAL, exponent, one), base, zero)
        # 0 < y < 1 is a root with infinite derivative; y = 1 is the base itself
        root = b.select(b.compare(Relation.LESS, exponent, one), self._steep(base), flat)
        # 0⁰ = 1, and 0ʸ jumps to 0 for y > 0: the derivative by the exponent is −∞
        at_zero = b.subtract(self._number(1.0), self._steep(exponent))
        not_positive = b.select(below_zero, pole, at_zero)
        return b.select(self._is_positive(exponent), root, not_positive)

    def _arc(self) -> NodeId:
        b, x = self._b, self._args[0]
        right = self._is_positive(x)
        # beyond ±1 the operation gives NaN; at ±1 the distance is 0 with derivative `STEEP`
        beyond = self._steep(b.subtract(x, self._chosen(right, 1.0, -1.0)))
        if self._node.op == Apply("asin"):
            return b.add(self._chosen(right, math.pi / 2, -math.pi / 2), beyond)
        return b.subtract(self._chosen(right, 0.0, math.pi), beyond)

    def _number(self, value: float) -> NodeId:
        """A constant in all elements.

        Infinity and NaN are quotients by 0: constants must be finite.
        """
        b = self._b
        if math.isfinite(value):
            number = b.constant(value, unit=None)
        else:
            # C, torch and CasADi evaluate 1/0, −1/0 and 0/0 the same way
            above = 0.0 if math.isnan(value) else math.copysign(1.0, value)
            number = b.divide(b.constant(above, unit=None), b.constant(0.0, unit=None))
        return b.broadcast(number, self._node.type.axes)

    def _steep(self, value: NodeId) -> NodeId:
        """0 with the derivative `STEEP`, for a value that is 0."""
        return self._b.multiply(self._number(STEEP), value)

    def _is_zero(self, value: NodeId) -> NodeId:
        # the IR has no `==`; |x| ≤ 0 is false for NaN
        return self._b.compare(Relation.LESS_EQUAL, self._b.apply("abs", value), self._number(0.0))

    def _is_positive(self, value: NodeId) -> NodeId:
        return self._b.compare(Relation.GREATER, value, self._number(0.0))

    def _chosen(self, condition: NodeId, then: float, otherwise: float) -> NodeId:
        return self._b.select(condition, self._number(then), self._number(otherwise))
