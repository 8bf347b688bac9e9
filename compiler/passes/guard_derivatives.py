"""Guards derivatives against infinity and NaN: in branches that are not taken, and where the
derivative itself is infinite.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from compiler.ir import ops
from compiler.ir.builder import GraphBuilder, copy_node, with_start, with_step
from compiler.ir.ops import Apply, Divide, Relation, Select
from compiler.ir.program import Graph, Node, NodeId, Program
from compiler.ir.types import Axis

SINGULAR = frozenset({"sqrt", "log", "pow", "asin", "acos", "atan2", "exp", "sinh", "cosh"})
"""Functions with an infinite or NaN value or derivative somewhere; division is handled
separately."""

SAFE = 0.5
"""An argument at which all of them, and 1/x, have a finite value and derivative."""

# without a condition the guard holds more often, which is safe
LONGEST = 8
"""Maximum number of conditions of nested branches, the inner ones, so that the pass is linear."""


@dataclass(frozen=True, slots=True)
class BranchCondition:
    """A condition under which a branch is used: a bool node, before it was repeated by `Broadcast`,
    and the value that it must have.
    """

    node: NodeId
    holds: bool


Guard = tuple[BranchCondition, ...]
"""Conditions that are true wherever the value is used, outermost first."""


def guard_untaken(program: Program) -> Program:
    """Gives divisions and singular functions a harmless argument where their branch is not taken.

    Before: any form. After: the same values. In reverse mode the untaken branch contributes 0 times
    a finite derivative instead of 0 · ∞. A value that is also used outside the branch does not
    change. Example, before and after:

        where(x > 0, sqrt(x), 0)
        where(x > 0, sqrt(where(x > 0, x, 0.5)), 0)
    """
    # start and step are separate graphs with separate guards
    roots = [output.node for output in program.outputs]
    roots += [state.next for state in program.states]
    roots += [node for loss in program.losses for node in loss.nodes]
    step, copies = guarded(program.step, roots)
    program = with_step(program, step.graph(), copies)
    start, copies = guarded(program.start, [state.start for state in program.states])
    return with_start(program, start.graph(), copies)


def guarded(graph: Graph, roots: Iterable[NodeId]) -> tuple[GraphBuilder, dict[NodeId, NodeId]]:
    """The graph as in `guard_untaken`, with only the nodes that the `roots` depend on: a builder
    with its nodes, and their new ids by the old ones.
    """
    roots = list(roots)
    guards = _guards(graph, roots)
    builder = GraphBuilder()
    copies: dict[NodeId, NodeId] = {}
    for index in _order(graph, guards, roots):
        node, guard = graph[index], guards[index]
        args = tuple(copies[arg] for arg in node.args)
        # only singular operations: a guard costs an operation, and 0 times a finite derivative is 0
        if guard and _is_singular(node.op):
            conditions = [(copies[condition.node], condition.holds) for condition in guard]
            args = _harmless(builder, node, args, conditions)
        copies[index] = copy_node(builder, node, args)
    return builder, copies


def _harmless(
    builder: GraphBuilder,
    node: Node,
    args: tuple[NodeId, ...],
    conditions: list[tuple[NodeId, bool]],
) -> tuple[NodeId, ...]:
    # the numerator is harmless; dividing by 0 is not
    kept = args[:1] if isinstance(node.op, ops.Divide) else ()
    guarded: list[NodeId] = []
    for arg in args[len(kept) :]:
        type = builder.type(arg)
        safe = builder.broadcast(builder.constant(SAFE), type.axes)
        # from the innermost condition to the outermost, each selects from the previous result
        for condition, holds in reversed(conditions):
            wide = builder.broadcast(condition, type.axes)
            branches = (arg, safe) if holds else (safe, arg)
            arg = builder.emit(ops.Select(), (wide, *branches), type)
        guarded.append(arg)
    return (*kept, *guarded)


def _guards(graph: Graph, roots: list[NodeId]) -> list[Guard | None]:
    """For each node the conditions that hold at all its uses, outermost first; None if no root
    depends on it.
    """
    guards: list[Guard | None] = [None] * len(graph)
    for root in roots:
        # a root is used unconditionally
        guards[root] = ()
    for index in reversed(range(len(graph))):
        node, guard = graph[index], guards[index]
        # no root depends on it
        if guard is None:
            continue
        for place, arg in enumerate(node.args):
            under = guard
            if isinstance(node.op, ops.Select) and place > 0:
                # a branch of a `where` is used where the condition holds, or where it does not
                condition = BranchCondition(graph.unrepeated(node.args[0]), place == 1)
                # an inner use of the same condition replaces the outer one
                under = (*(c for c in guard if c.node != condition.node), condition)[-LONGEST:]
            under = tuple(
                c for c in under if _reaches(graph[c.node].type.axes, node.op, graph[arg].type.axes)
            )
            before = guards[arg]
            # only conditions that all uses share are true wherever the value is used
            guards[arg] = under if before is None else tuple(c for c in before if c in under)
    return guards


def _reaches(condition: tuple[Axis, ...], op: ops.Op, operand: tuple[Axis, ...]) -> bool:
    """True if a condition with these axes, which holds for elements of the value of `op`, applies
    in the same way to an operand with the axes `operand`.
    """
    match op:
        # a reshape moves the elements of a condition with axes
        case ops.Reshape():
            return not condition
        case ops.Slice(axis) | ops.Concat(axis):
            return set(condition) <= {a for a in operand if a.name != axis}
        case _:
            return set(condition) <= set(operand)


def _is_singular(op: ops.Op) -> bool:
    return isinstance(op, ops.Divide) or (isinstance(op, ops.Apply) and op.function in SINGULAR)


def _order(graph: Graph, guards: list[Guard | None], roots: list[NodeId]) -> list[NodeId]:
    """The nodes that the roots depend on, each after its operands; a singular operation also after
    the conditions of its guard.

    Such an order exists. Suppose c depended on a node that c′ guards, and c′ on one that c guards.
    Then every `Select` by c would be in a branch of one by c′ and vice versa. That is impossible
    for the last of them in the order of the graph.
    """
    order: list[NodeId] = []
    placed = [False] * len(graph)
    for root in roots:
        # an explicit stack, as graphs are deeper than Python's recursion limit; a node is ready at
        # its second visit
        stack = [(root, False)]
        while stack:
            index, ready = stack.pop()
            if placed[index]:
                continue
            if ready:
                placed[index] = True
                order.append(index)
                continue
            node, guard = graph[index], guards[index]
            needs = [*node.args]
            if guard and _is_singular(node.op):
                needs += [condition.node for condition in guard]
            stack.append((index, True))
            stack.extend((need, False) for need in reversed(needs) if not placed[need])
    return order


STEEP = 1e30
"""Replaces an infinite derivative; finite in single precision too, so that 0 times it is 0."""


def guard_infinite_slopes(program: Program) -> Program:
    """Gives √, log, pow, asin, acos and ÷ a harmless argument where their derivative is infinite.

    Before: any form. After: the same values. The replacement has the same value and the derivative
    `STEEP`. A product of derivatives with a factor 0 is then 0 in torch and CasADi too, as in
    reverse mode (`slope_product`). A quotient by 0 has this derivative in its divisor only.
    Example, before and after:

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
    """Replaces one operation `node` with the operands `args` by a formula with the same value and a
    finite derivative.
    """

    def __init__(self, builder: GraphBuilder, node: Node, args: tuple[NodeId, ...]) -> None:
        self._b, self._node, self._args = builder, node, args

    def result(self) -> NodeId | None:
        """The id of the node that replaces the operation; None if its derivatives are finite
        anyway.
        """
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
        """The node of a `where`: the result of `value()` where the bool node `there` is true,
        otherwise the operation.

        The operand of the operation at `position` is replaced by a harmless one where `there` is
        true.
        """
        # the operation gets a harmless operand, since libraries differentiate both branches
        b, args = self._b, list(self._args)
        type = b.type(args[position])
        args[position] = b.emit(Select(), (there, self._number(SAFE), args[position]), type)
        usual = b.emit(self._node.op, tuple(args), self._node.type)
        return b.emit(Select(), (there, value(), usual), self._node.type)

    def _quotient(self) -> NodeId:
        """The value of a quotient where its divisor is 0: ±∞ with the sign of the quotient, NaN for
        0/0 and NaN.
        """
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
        """The value of xʸ where the base x is 0: ∞ for y < 0; 1 for y = 0, with a steep derivative
        by y; 0 with the derivative `STEEP` for 0 < y < 1; x itself for y = 1; 0 above.
        """
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
        """A constant, repeated for all elements of the operation.

        Infinity and NaN are expressed as quotients by 0, since constants must be finite.
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
        """A node with the value 0 and the derivative `STEEP` with respect to `value`, where `value`
        is 0.
        """
        return self._b.multiply(self._number(STEEP), value)

    def _is_zero(self, value: NodeId) -> NodeId:
        # the IR has no `==`; |x| ≤ 0 is false for NaN
        return self._b.compare(Relation.LESS_EQUAL, self._b.apply("abs", value), self._number(0.0))

    def _is_positive(self, value: NodeId) -> NodeId:
        return self._b.compare(Relation.GREATER, value, self._number(0.0))

    def _chosen(self, condition: NodeId, then: float, otherwise: float) -> NodeId:
        return self._b.select(condition, self._number(then), self._number(otherwise))
