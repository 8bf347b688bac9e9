"""Keeps slopes finite for libraries that differentiate by themselves and multiply 0 by ∞."""

from __future__ import annotations

import math
from collections.abc import Callable

from compiler.ir.builder import GraphBuilder
from compiler.ir.graph_copy import copy_node, with_start, with_step
from compiler.ir.ops import Apply, Divide, Relation, Select
from compiler.ir.program import Graph, Node, NodeId, Program
from compiler.passes.derivatives.guard_untaken import SAFE

STEEP = 1e30
"""Stands for an infinite slope: finite in single precision too, so that 0 times it is 0."""


def guard_infinite_slopes(program: Program) -> Program:
    """Gives √, log, pow, asin, acos and ÷ a harmless argument where their slope is infinite.

    Before: any form. After: the same values. What is there instead has the same value and the
    slope `STEEP`, so that a product of slopes with a factor 0 is 0, as reverse mode has it
    (`slope_product`), in torch and CasADi too. A quotient by 0 has this slope in its divisor alone.

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
        # a label is the spec's name for a value: what stands in its place keeps it
        if node.label is not None:
            builder.name(copies[index], node.label)
    return builder.graph(), copies


class _Guard:
    """One operation and its operands."""

    def __init__(self, builder: GraphBuilder, node: Node, args: tuple[NodeId, ...]) -> None:
        self._b, self._node, self._args = builder, node, args

    def result(self) -> NodeId | None:
        """The node that replaces the operation; None where its slopes are finite."""
        b, args = self._b, self._args
        # decided by structure, such as x² + 1: where nothing can be 0 no guard is needed
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
                # exact near 1, where it counts (Sterbenz)
                edge = b.subtract(self._number(1.0), b.apply("abs", args[0]))
                return self._split(0, self._is_zero(edge), self._arc)
            case _:
                return None

    def _split(self, position: int, there: NodeId, value: Callable[[], NodeId]) -> NodeId:
        """The value there, elsewhere the operation."""
        # elsewhere the operation with a harmless operand: libraries differentiate both branches
        b, args = self._b, list(self._args)
        type = b.type(args[position])
        args[position] = b.emit(Select(), (there, self._number(SAFE), args[position]), type)
        usual = b.emit(self._node.op, tuple(args), self._node.type)
        return b.emit(Select(), (there, value(), usual), self._node.type)

    def _quotient(self) -> NodeId:
        """±∞ by the signs of both, NaN for 0/0 and NaN."""
        b, (above, below) = self._b, self._args
        # no comparison tells −0 from 0, 1/x does
        # 1/−0 is −∞
        sign_of_zero = self._is_positive(b.divide(self._number(1.0), below))
        infinity = self._chosen(sign_of_zero, math.inf, -math.inf)
        # 1/x falls on both sides of 0
        falling = b.negate(self._steep(below))
        positive = b.add(infinity, falling)
        negative = b.negate(positive)
        known = b.select(
            b.compare(Relation.LESS, above, self._number(0.0)), negative, self._number(math.nan)
        )
        # NaN is neither positive nor negative: 0/0 and NaN end at NaN
        return b.select(self._is_positive(above), positive, known)

    def _power(self) -> NodeId:
        """0ʸ: steep for y < 1, the base for 1, flat above; 0⁰ is 1 and falls with y."""
        b, (base, exponent) = self._b, self._args
        zero, one = self._number(0.0), self._number(1.0)
        below_zero = b.compare(Relation.LESS, exponent, zero)
        pole = b.subtract(self._number(math.inf), self._steep(base))
        flat = b.select(b.compare(Relation.LESS_EQUAL, exponent, one), base, zero)
        # 0ʸ for 0 < y < 1 is a root, and steep; y = 1 is the base itself
        root = b.select(b.compare(Relation.LESS, exponent, one), self._steep(base), flat)
        # 0⁰ = 1, and 0ʸ jumps to 0 for y > 0: the slope by the exponent is −∞
        at_zero = b.subtract(self._number(1.0), self._steep(exponent))
        not_positive = b.select(below_zero, pole, at_zero)
        return b.select(self._is_positive(exponent), root, not_positive)

    def _arc(self) -> NodeId:
        b, x = self._b, self._args[0]
        right = self._is_positive(x)
        # beyond ±1 is NaN by the operation itself; at ±1 the distance is 0 and its slope `STEEP`
        beyond = self._steep(b.subtract(x, self._chosen(right, 1.0, -1.0)))
        if self._node.op == Apply("asin"):
            return b.add(self._chosen(right, math.pi / 2, -math.pi / 2), beyond)
        return b.subtract(self._chosen(right, 0.0, math.pi), beyond)

    def _number(self, value: float) -> NodeId:
        """The number everywhere; a program has no infinite constants, but quotients by 0."""
        b = self._b
        if math.isfinite(value):
            number = b.constant(value, unit=None)
        else:
            # 1/0, −1/0 and 0/0 are what C, torch and CasADi make of them, too
            above = 0.0 if math.isnan(value) else math.copysign(1.0, value)
            number = b.divide(b.constant(above, unit=None), b.constant(0.0, unit=None))
        return b.broadcast(number, self._node.type.axes)

    def _steep(self, value: NodeId) -> NodeId:
        """0 with the slope `STEEP`, where the value is 0."""
        return self._b.multiply(self._number(STEEP), value)

    def _is_zero(self, value: NodeId) -> NodeId:
        # not x == 0: IR has no equality, and |x| ≤ 0 is false for NaN
        return self._b.compare(Relation.LESS_EQUAL, self._b.apply("abs", value), self._number(0.0))

    def _is_positive(self, value: NodeId) -> NodeId:
        return self._b.compare(Relation.GREATER, value, self._number(0.0))

    def _chosen(self, condition: NodeId, then: float, otherwise: float) -> NodeId:
        return self._b.select(condition, self._number(then), self._number(otherwise))
