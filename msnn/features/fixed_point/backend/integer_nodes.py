"""Writes integer nodes as C: one constant per node, loops for long sums over adjacent memory."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import assert_never

from backends.c_language import tree as c
from backends.c_language.places import Index
from backends.c_language.scope import BlockScope
from backends.c_lowering.spec_notes import span_text
from backends.c_lowering.sums import in_blocks
from msnn.features.fixed_point.backend.helpers import FixedHelpers
from msnn.features.fixed_point.integers import program as integer
from msnn.features.fixed_point.integers.program import (
    IntegerNode,
    ReadMemory,
    ReadWord,
    WeightedSum,
)

_SHORT = 3
"""Maximum number of terms of a sum that is written as one expression."""

_BLOCK = 4
"""Number of terms that one iteration of a loop adds to a long sum."""


@dataclass(frozen=True, slots=True)
class IntegerLeafSource:
    """Gives the C expressions of the leaves of an integer graph: elements of ports and memories, by
    name and index.
    """

    word: Callable[[str, Index], c.Expression]
    """The expression for an element of a port."""
    memory: Callable[[str, Index], c.Expression]
    """The expression for an element of a memory."""
    wide: frozenset[str] = frozenset()
    """Names of memories stored with the bits of a sum instead of a word."""
    loaded: frozenset[int] = frozenset()
    """Nodes that read a memory and are needed after that memory was overwritten."""


class IntegerNodes:
    """Writes the nodes of one graph into `scope`, a block of one C function. `surroundings` gives
    the expressions of leaves.
    """

    def __init__(
        self,
        nodes: Sequence[integer.IntegerNode],
        width: integer.Width,
        surroundings: IntegerLeafSource,
        helpers: FixedHelpers,
        scope: BlockScope,
    ) -> None:
        self._nodes, self._largest_word, self._surroundings = (
            nodes,
            width.largest_word,
            surroundings,
        )
        self._helpers, self._scope = helpers, scope
        self._tables: dict[tuple[int, ...], c.Name] = {}
        self._products = matrix_products(nodes, width.largest_word)
        self._rows = {
            row: (first, place)
            for first, rows in self._products.items()
            for place, row in enumerate(rows)
        }

    def write(self) -> None:
        """Writes a local constant for every node that is not written inline in the expressions that
        use it.
        """
        for index, node in enumerate(self._nodes):
            # the rows of a product are written together, where the first of them stands
            if self.is_inline(index) or (index in self._rows and index not in self._products):
                continue
            if node.span is not None:
                self._scope.note(f"spec: {span_text(node.span)}")
            if index in self._products:
                self._write_product(self._products[index])
            elif isinstance(node.op, integer.WeightedSum) and len(node.args) > _SHORT:
                self._write_sum(c.Name(f"n{index}"), node.op, node.args)
            else:
                # a constant a node, as in the integer program: each keeps the bounds that were
                # proved for it
                value = self._expression(node)
                # by the number of the node: a word of the spec may be many nodes of other scales
                self._scope.add(c.Declare(c.CType.SUM, f"n{index}", value, constant=True))

    def node(self, index: int) -> integer.IntegerNode:
        """The graph node with this index."""
        return self._nodes[index]

    def value(self, index: int) -> c.Expression:
        """The C expression for a node, in the type of sums."""
        if index in self._rows:
            first, place = self._rows[index]
            # rows of a product are elements of the array that the first of them declared
            return c.Element(c.Name(f"n{first}"), c.Unsigned(place))
        return self._leaf(self._nodes[index]) if self.is_inline(index) else c.Name(f"n{index}")

    def as_word(self, index: int) -> c.Expression:
        """The C expression for a node whose value fits a word, in the type of words."""
        op = self._nodes[index].op
        match op:
            case integer.ReadWord() | integer.ReadMemory() if self.is_inline(
                index
            ) and not self._is_wide(op):
                return self.element(op, Index(op.index))
            case _:
                return c.Convert(c.CType.WORD, self.value(index))

    def element(self, op: integer.ReadWord | integer.ReadMemory, at: Index) -> c.Expression:
        """The C expression for the element `at` of the port or memory that the operation `op`
        reads.
        """
        match op:
            case integer.ReadWord(port):
                return self._surroundings.word(port, at)
            case integer.ReadMemory(memory):
                return self._surroundings.memory(memory, at)
            case _:
                assert_never(op)

    def is_inline(self, index: int) -> bool:
        """True if the node is written inline in the expressions that use it."""
        op = self._nodes[index].op
        # once its memory has moved a read would find the next state: those are kept in a constant
        if isinstance(op, integer.ReadMemory):
            return index not in self._surroundings.loaded
        return isinstance(op, integer.Literal | integer.ReadWord)

    def _is_wide(self, op: integer.ReadWord | integer.ReadMemory) -> bool:
        return isinstance(op, integer.ReadMemory) and op.memory in self._surroundings.wide

    def _leaf(self, node: integer.IntegerNode) -> c.Expression:
        match node.op:
            case integer.Literal(value):
                return c.Integer(value)
            case integer.ReadWord() | integer.ReadMemory():
                return self._read(node.op, Index(node.op.index))
            case _:
                raise AssertionError("only leaves are written where they are used")

    def _read(self, op: integer.ReadWord | integer.ReadMemory, at: Index) -> c.Expression:
        element = self.element(op, at)
        return element if self._is_wide(op) else c.Convert(c.CType.SUM, element)

    def _expression(self, node: integer.IntegerNode) -> c.Expression:
        args = [self.value(arg) for arg in node.args]
        match node.op:
            case integer.WeightedSum(constant, coefficients):
                return _sum(constant, coefficients, args)
            case integer.Product():
                return c.Binary("*", args[0], args[1])
            case integer.RoundShift(bits):
                return self._helpers.rounded(args[0], bits)
            case integer.Smaller():
                # both arms have been computed: neither has an effect or can overflow, as their
                # bounds are proved
                return c.Conditional(c.Binary("<", args[0], args[1]), args[0], args[1])
            case integer.Larger():
                return c.Conditional(c.Binary(">", args[0], args[1]), args[0], args[1])
            case integer.Choose(relation):
                left, right, then, otherwise = args
                if isinstance(then, c.Integer) and isinstance(otherwise, c.Integer):
                    then = c.Convert(c.CType.SUM, then)  # not the small type of two small literals
                return c.Conditional(c.Binary(relation.value, left, right), then, otherwise)
            case integer.IntegerLookup(first, bits, values):
                distance = c.Binary("-", args[0], c.Integer(first)) if first else args[0]
                return self._helpers.interpolated(self._table(values), distance, bits)
            case integer.Literal() | integer.ReadWord() | integer.ReadMemory():
                return self._leaf(node)
            case _:
                assert_never(node.op)

    def _write_product(self, rows: tuple[int, ...]) -> None:
        """Writes a matrix product as two nested loops; `rows` are the nodes of its result. Each row
        sums its terms in their original order.
        """
        scope, first = self._scope, rows[0]
        args = self._nodes[first].args
        # operands in an array of their own: the inner loop runs along two arrays of words
        operands, sums = c.Name(f"x{first}"), c.Name(f"n{first}")
        scope.add(c.Declare(c.CType.WORD, operands.text, size=len(args)))
        for place, arg in enumerate(args):
            scope.assign(c.Element(operands, c.Unsigned(place)), self.as_word(arg))
        ops = [op for row in rows if isinstance(op := self._nodes[row].op, integer.WeightedSum)]
        weights = self._table(tuple(weight for op in ops for weight in op.coefficients))
        constants = tuple(op.constant for op in ops)
        # a table of equal numbers would only take flash
        begins = self._table(constants) if len(set(constants)) > 1 else None
        scope.add(c.Declare(c.CType.SUM, sums.text, size=len(rows)))
        with scope.loop(len(rows)) as (row, inner):
            begin: c.Expression = c.Integer(constants[0])
            if begins is not None:
                begin = c.Convert(c.CType.SUM, c.Element(begins, row.expression()))
            total = c.Name(f"total{first}")
            inner.add(c.Declare(c.CType.SUM, total.text, begin))
            with inner.loop(len(args)) as (along, innermost):
                place = row.times(len(args)).plus(along)
                weight = c.Convert(c.CType.SUM, c.Element(weights, place.expression()))
                value = c.Convert(c.CType.SUM, c.Element(operands, along.expression()))
                innermost.assign(total, c.Binary("+", total, c.Binary("*", weight, value)))
            inner.assign(c.Element(sums, row.expression()), total)

    def _write_sum(self, name: c.Name, op: integer.WeightedSum, args: Sequence[int]) -> None:
        """Writes the sum `op` of the nodes `args` to a variable, in its given order; in another
        order, partial sums might overflow.
        """
        total = _Total(name, op.constant, self._scope)
        for begin, count in neighbours([self._nodes[arg] for arg in args]):
            first = self._nodes[args[begin]].op
            if count > 1 and isinstance(first, integer.ReadWord | integer.ReadMemory):
                self._add_neighbours(total, op.coefficients[begin : begin + count], first)
                continue
            for place in range(begin, begin + count):
                total.add(*_term(op.coefficients[place], self.value(args[place])), self._scope)

    def _add_neighbours(
        self, total: _Total, weights: tuple[int, ...], first: integer.ReadWord | integer.ReadMemory
    ) -> None:
        """Adds elements that are adjacent in memory to a sum, with a loop. `first` reads the first
        of them; there is one weight per element.
        """
        total.begin()
        # equal weights, as of a mean, need no table
        table = self._table(weights) if len(set(weights)) > 1 else None

        def add(along: Index, inner: BlockScope) -> None:
            value = self._read(first, along.plus(Index(first.index)))
            if table is None:
                total.add(*_term(weights[0], value), inner)
            else:
                weight = c.Convert(c.CType.SUM, c.Element(table, along.expression()))
                # with the weights in a table a sign is in the number: `_term` would need it to be
                # known in the text
                total.add("+", c.Binary("*", weight, value), inner)

        in_blocks(len(weights), _BLOCK, self._scope, add)

    def _table(self, values: tuple[int, ...]) -> c.Name:
        """The name of the constant C table with these values, which is declared once, before its
        first use.
        """
        if values not in self._tables:
            name = c.Name(f"table_{len(self._tables) + 1}")
            # words take half the flash of sums
            fits = max(map(abs, values)) <= self._largest_word
            self._scope.add(
                c.ConstantTable(name.text, values, c.CType.WORD if fits else c.CType.SUM)
            )
            self._tables[values] = name
        return self._tables[values]


class _Total:
    """A C variable that accumulates a sum, term by term; the first term or constant declares it."""

    def __init__(self, name: c.Name, constant: int, scope: BlockScope) -> None:
        self._name, self._scope = name, scope
        self._begun = False
        if constant:
            self._declare(c.Integer(constant))

    def begin(self) -> None:
        """Declares the variable as 0 if it has no term yet."""
        if not self._begun:
            self._declare(c.Integer(0))

    def add(self, sign: str, term: c.Expression, scope: BlockScope) -> None:
        """Adds a term (`sign` is `+`) or subtracts it (`-`); `scope` is the block for the
        statement.
        """
        if self._begun:
            scope.assign(self._name, c.Binary(sign, self._name, term))
        else:
            self._declare(c.Unary("-", term) if sign == "-" else term)

    def _declare(self, value: c.Expression) -> None:
        self._scope.add(c.Declare(c.CType.SUM, self._name.text, value))
        self._begun = True


def _term(coefficient: int, value: c.Expression) -> tuple[str, c.Expression]:
    """The sign of coefficient · value, as `+` or `-`, and the expression of
    |coefficient| · value.
    """
    size = abs(coefficient)
    term = value if size == 1 else c.Binary("*", c.Integer(size), value)
    return ("-" if coefficient < 0 else "+"), term


def _sum(constant: int, coefficients: Sequence[int], args: Sequence[c.Expression]) -> c.Expression:
    total: c.Expression | None = c.Integer(constant) if constant else None
    for coefficient, arg in zip(coefficients, args, strict=True):
        sign, term = _term(coefficient, arg)
        if total is None:
            total = c.Unary("-", term) if sign == "-" else term
        else:
            total = c.Binary(sign, total, term)
    return c.Integer(0) if total is None else total


_FEWEST_READS = 8
"""Minimum number of elements for which a loop is shorter than separate statements."""

_TERM, _COEFFICIENT, _LOOP = 8, 2, 64
"""Bytes of code on Cortex-M0 (gcc 12 -Os) of a written-out term, of a coefficient in a table and,
roughly, of two loops."""

_FEWEST_TERMS = 4
"""Minimum number of terms of a row; shorter sums are one expression."""


def neighbours(nodes: Sequence[IntegerNode]) -> Iterator[tuple[int, int]]:
    """Yields the index of the first node and the length of each group of nodes that read ascending
    elements of one port or memory.

    Groups that are too short for a loop are split into single nodes.
    """
    begin = 0
    while begin < len(nodes):
        end = begin + 1
        while end < len(nodes) and _follows(nodes[end - 1], nodes[end]):
            end += 1
        if end - begin >= _FEWEST_READS:
            yield begin, end - begin
        else:
            yield from ((place, 1) for place in range(begin, end))
        begin = end


def _follows(before: IntegerNode, after: IntegerNode) -> bool:
    op = before.op
    return isinstance(op, ReadWord | ReadMemory) and after.op == replace(op, index=op.index + 1)


def matrix_products(nodes: Sequence[IntegerNode], largest_word: int) -> dict[int, tuple[int, ...]]:
    """Finds matrix products among the sums of a graph: the indices of all rows of a product in
    order, by the index of its first row.

    All rows have the same operands in the same order, so all can be computed at the first row. All
    factors fit a word.
    """
    rows: dict[tuple[int, ...], list[int]] = {}
    for index, node in enumerate(nodes):
        op = node.op
        if isinstance(op, WeightedSum) and len(node.args) >= _FEWEST_TERMS:
            in_words = all(abs(coefficient) <= largest_word for coefficient in op.coefficients)
            if in_words and all(_is_word(nodes[arg], largest_word) for arg in node.args):
                rows.setdefault(node.args, []).append(index)
    return {
        found[0]: tuple(found) for args, found in rows.items() if _is_shorter(len(found), len(args))
    }


def _is_word(node: IntegerNode, largest_word: int) -> bool:
    return -largest_word <= node.low and node.high <= largest_word


def _is_shorter(rows: int, terms: int) -> bool:
    """True if loops take less code for a matrix product with this number of rows and terms per row.
    Copying an operand to an array costs about one term.
    """
    as_loop = _LOOP + terms * _TERM + rows * terms * _COEFFICIENT
    return rows > 1 and as_loop < rows * terms * _TERM
