"""Analyses which values can be infinite or 0, so that derivatives guard only products in which 0·∞
may occur.

The analysis uses the operations only, not the data, and visits each node once. Dividing by a value
counts as harmless in three cases:

- The divisor is a nonzero constant.
- It depends on parameters only; if it is 0, the model itself is not finite.
- It is built from those and from positive values (`1 + x²`, `exp`, `cosh`).

Overflow is ignored: its results count as finite.
"""

from __future__ import annotations

from enum import IntEnum

from compiler.ir import ops
from compiler.ir.nodes import NodeStore
from compiler.ir.program import Node, NodeId


class Sign(IntEnum):
    """The sign that is known of all elements of a value. A member with a higher number is the
    stronger fact.
    """

    ANY = 0
    NOT_NEGATIVE = 1
    NOT_ZERO = 2
    POSITIVE = 3


_POSITIVE = frozenset({"exp", "cosh", "sigmoid", "softplus"})
_BOUNDED = frozenset({"sin", "cos", "asin", "acos", "atan", "atan2", "tanh", "sigmoid", "sign"})


class Infinite(IntEnum):
    """Says if a value can become infinite although all inputs are finite, and if the model's own
    values are infinite in this case, too.
    """

    NEVER = 0
    WITH_MODEL = 1
    """Like the derivative of 1/x or log(x): the function itself is infinite there too, unless
    the factors between it and the result are 0."""
    ALONE = 2
    """Like the derivative of sqrt(x): the function itself is finite there."""


class InfiniteValues:
    """Answers, for the nodes of a growing graph, if their values can be infinite, 0 or negative.

    Each node is analysed once, when a question first needs it.
    """

    def __init__(self, graph: NodeStore) -> None:
        self._graph = graph
        self._signs: list[Sign] = []
        self._divisor_signs: list[Sign] = []
        """The sign of each node, assuming that no parameter, and nothing computed from parameters
        alone, is 0."""
        self._fixed: list[bool] = []
        self._infinite: list[Infinite] = []
        self._made_of: list[bool] = []
        self._unbounded: list[bool] = []
        """True if the value can be ±∞. sin(1/x) cannot, although 1/x can: it is NaN there."""

    def expect(self, node: NodeId) -> None:
        """Marks `node` as possibly infinite, whatever its operands are. Call it before a node that
        uses this one is analysed.
        """
        self._look(node)
        self._infinite[node] = Infinite.ALONE
        self._made_of[node] = True
        self._unbounded[node] = True

    def sign(self, node: NodeId) -> Sign:
        """The sign that is proved for every element of the node's value; `Sign.ANY` if
        nothing is.
        """
        self._look(node)
        return self._signs[node]

    def is_never_zero(self, node: NodeId) -> bool:
        """True if it is proved that no element of the node's value is 0."""
        self._look(node)
        return self._signs[node] >= Sign.NOT_ZERO

    def divides(self, node: NodeId) -> bool:
        """True if a division by the value gives an infinity only where the model itself is not
        finite.

        That is, no element can be 0, provided that no parameter, and nothing computed from
        parameters alone, is 0.
        """
        self._look(node)
        return self._divisor_signs[node] >= Sign.NOT_ZERO

    def can_be_infinite(self, node: NodeId) -> bool:
        """True if an element of the value can be infinite. A product with it needs a test if the
        other factor is 0 (`GraphBuilder.zero_with`), since 0·∞ is NaN.
        """
        self._look(node)
        return self._infinite[node] is not Infinite.NEVER

    def is_made_of_infinite(self, node: NodeId) -> bool:
        """True if the value, or any value from which it is computed, can be infinite."""
        self._look(node)
        return self._made_of[node]

    def _look(self, last: NodeId) -> None:
        for index in range(len(self._signs), last + 1):
            node = self._graph.node(index)
            # operands come before their users, so their signs are known
            sign = _sign(node, [self._signs[arg] for arg in node.args])
            divisor_sign = _sign(node, [self._divisor_signs[arg] for arg in node.args])
            fixed = isinstance(node.op, ops.Constant | ops.ReadParameter)
            fixed = fixed or (bool(node.args) and all(self._fixed[arg] for arg in node.args))
            # a learned divisor of 0 makes the model itself infinite, so its derivatives may be too
            if fixed and divisor_sign is Sign.ANY:
                divisor_sign = Sign.NOT_ZERO
            unbounded = any(self._unbounded[arg] for arg in node.args)
            if unbounded and isinstance(node.op, ops.Divide | ops.Apply):
                sign = _WITH_ZERO.get(sign, sign)  # 1/∞ and exp(−∞) are 0
                divisor_sign = _WITH_ZERO.get(divisor_sign, divisor_sign)
            self._signs.append(sign)
            self._divisor_signs.append(divisor_sign)
            self._fixed.append(fixed)
            infinite = self._when_infinite(node)
            itself = infinite is not Infinite.NEVER
            self._infinite.append(infinite)
            self._made_of.append(itself or any(self._made_of[arg] for arg in node.args))
            self._unbounded.append(itself or (unbounded and not _is_bounded(node)))

    def _when_infinite(self, node: Node) -> Infinite:
        of = [self._infinite[arg] for arg in node.args]
        match node.op:
            case ops.Compare():
                return Infinite.NEVER
            case ops.Apply(function) if function in _BOUNDED:
                return Infinite.NEVER
            case ops.Clamp():
                # a clamp reduces infinite values to its limits: only these matter
                return max(of[1:])
            case _ if Infinite.ALONE in of:
                return Infinite.ALONE
            case ops.Negate() | ops.Named() | ops.Broadcast() | ops.Reshape() | ops.Slice():
                return of[0]
            case ops.Divide():
                # 1/x of any x is infinite where the model is; 1/√x and 1/x² occur in derivatives
                # of functions that are finite there
                return _BY_DIVISOR.get(self._divisor_signs[node.args[1]], Infinite.NEVER)
            case ops.Apply("log") if self._signs[node.args[0]] < Sign.NOT_ZERO:
                return Infinite.WITH_MODEL
            case ops.Apply("pow") if self._signs[node.args[0]] < Sign.NOT_ZERO:
                return Infinite.ALONE
            case _:
                return Infinite.NEVER


def _is_bounded(node: Node) -> bool:
    """True if the node is a function such as sin or tanh, whose value is never infinite."""
    return isinstance(node.op, ops.Apply) and node.op.function in _BOUNDED


def _sign(node: Node, of: list[Sign]) -> Sign:
    """The sign that is known of a node's value, from the signs `of` of its operands."""
    known = [sign for sign in of if sign in (Sign.NOT_NEGATIVE, Sign.POSITIVE)]
    match node.op:
        case ops.Constant(values) if node.type.kind == "real":
            return _of_numbers(values)
        case ops.Add():
            # if no term is negative, one positive term is enough; opposite signs may cancel
            return max(of) if len(known) == len(of) else Sign.ANY
        # a square
        case ops.Multiply() if node.args[0] == node.args[1]:
            return Sign.POSITIVE if of[0] >= Sign.NOT_ZERO else Sign.NOT_NEGATIVE
        case ops.Multiply() | ops.Divide():
            return _of_product(of[0], of[1])
        case ops.Negate():
            return Sign.NOT_ZERO if of[0] >= Sign.NOT_ZERO else Sign.ANY
        case ops.Maximum():
            return max(known, default=_common(of))
        case ops.Clamp():
            # a clamp is at least the smaller of its limits, which may cross
            limits = _common(of[1:])
            return limits if limits in known else Sign.ANY
        case ops.Select():
            return _common(of[1:])
        case ops.Sum():
            # nonzero terms may cancel to 0; positive terms may not
            return of[0] if of[0] in known else Sign.ANY
        case ops.Contract():
            product = _of_product(of[0], of[1])
            # nonzero terms may cancel to 0
            return product if product is not Sign.NOT_ZERO else Sign.ANY
        case ops.Apply(function):
            return _sign_of_function(function, of)
        case ops.Minimum() | ops.Named() | ops.Structure():
            return _common(of)
        case _:
            return Sign.ANY


def _sign_of_function(function: str, of: list[Sign]) -> Sign:
    if function in _POSITIVE:
        return Sign.POSITIVE
    if function == "sqrt":
        return Sign.POSITIVE if of[0] is Sign.POSITIVE else Sign.NOT_NEGATIVE
    if function == "abs":
        return Sign.POSITIVE if of[0] >= Sign.NOT_ZERO else Sign.NOT_NEGATIVE
    if function == "pow" and of[0] is Sign.POSITIVE:
        return Sign.POSITIVE
    return Sign.ANY


_WITH_ZERO = {Sign.POSITIVE: Sign.NOT_NEGATIVE, Sign.NOT_ZERO: Sign.ANY}
_BY_DIVISOR = {Sign.ANY: Infinite.WITH_MODEL, Sign.NOT_NEGATIVE: Infinite.ALONE}
"""A divisor that is a root or a square and can be 0 occurs in derivatives of finite functions."""


def _of_numbers(values: tuple[float, ...]) -> Sign:
    smallest = min(values, default=0.0)
    if smallest > 0:
        return Sign.POSITIVE
    if all(value != 0 for value in values):
        return Sign.NOT_ZERO
    return Sign.NOT_NEGATIVE if smallest >= 0 else Sign.ANY


def _of_product(left: Sign, right: Sign) -> Sign:
    if Sign.ANY in (left, right):
        return Sign.ANY
    if Sign.NOT_NEGATIVE in (left, right):
        # a nonnegative times a nonzero value can be 0 or negative
        return Sign.ANY if Sign.NOT_ZERO in (left, right) else Sign.NOT_NEGATIVE
    return min(left, right)


def _common(signs: list[Sign]) -> Sign:
    """The strongest sign that every one of the `signs` implies; `signs` is not empty."""
    distinct = set(signs)
    if distinct <= {Sign.NOT_NEGATIVE, Sign.POSITIVE}:
        return min(signs)
    return Sign.NOT_ZERO if min(distinct) >= Sign.NOT_ZERO else Sign.ANY
