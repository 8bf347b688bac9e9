"""Prints integer nodes as C: one statement a node, in the order of the program."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import assert_never

from backends.c.spec_notes import span_text
from compiler.fixed_point.integer_program import (
    Choose,
    IntegerNode,
    Larger,
    Literal,
    Lookup,
    Product,
    ReadMemory,
    ReadWord,
    RoundShift,
    Smaller,
    WeightedSum,
    Width,
)


def literal(value: int, width: Width) -> str:
    """An integer of the type of sums."""
    text = str(abs(value)) if width.sum == 32 else f"INT64_C({abs(value)})"
    return f"(-{text})" if value < 0 else text


@dataclass(frozen=True, slots=True)
class Statements:
    """The nodes of one graph as C; tables that they need are collected."""

    width: Width
    prefix: str
    nodes: Sequence[IntegerNode]
    word: Callable[[str, int], str]
    """What reads an element of a port."""
    memory: Callable[[str, int], str]
    """What reads an element of a memory."""
    tables: dict[tuple[int, ...], str]
    """Name of each table by its values; shared by the graphs of a file."""
    wide: frozenset[str] = frozenset()
    """Memories that are kept as sums."""
    loaded: frozenset[int] = frozenset()
    """Reads of memories that are needed after a memory has changed."""

    def lines(self) -> Iterator[str]:
        """Declarations of all nodes that are not written where they are used."""
        place = None
        for index, node in enumerate(self.nodes):
            if self._is_inline(index):
                continue
            if node.span is not None and node.span.line != place:
                place = node.span.line
                yield f"/* spec: {span_text(node.span)} */"
            yield f"const {self.prefix}_sum_t n{index} = {self._expression(node)};"

    def value(self, index: int) -> str:
        """A node where it is used."""
        return self._inline(self.nodes[index]) if self._is_inline(index) else f"n{index}"

    def as_word(self, index: int) -> str:
        """A node that fits a word, as one."""
        match self.nodes[index].op:
            case ReadWord(port, element):
                return self.word(port, element)
            case ReadMemory(memory, element) if self._is_inline(index) and memory not in self.wide:
                return self.memory(memory, element)
            case _:
                return f"({self.prefix}_word_t){self.value(index)}"

    def _is_inline(self, index: int) -> bool:
        op = self.nodes[index].op
        if isinstance(op, ReadMemory):
            return index not in self.loaded
        return isinstance(op, Literal | ReadWord)

    def _inline(self, node: IntegerNode) -> str:
        match node.op:
            case Literal(value):
                return self._literal(value)
            case ReadWord(port, index):
                return f"({self.prefix}_sum_t){self.word(port, index)}"
            case ReadMemory(memory, index):
                if memory in self.wide:
                    return self.memory(memory, index)
                return f"({self.prefix}_sum_t){self.memory(memory, index)}"
            case _:
                raise AssertionError("only leaves are written where they are used")

    def _literal(self, value: int) -> str:
        return literal(value, self.width)

    def _expression(self, node: IntegerNode) -> str:
        args = [self._operand(arg) for arg in node.args]
        match node.op:
            case WeightedSum(constant, coefficients):
                return self._sum(constant, coefficients, args)
            case Product():
                return f"{args[0]} * {args[1]}"
            case RoundShift(bits):
                half = self._literal(1 << (bits - 1))
                return f"{self.prefix}_shifted({args[0]} + {half}, {bits}U)"
            case Smaller():
                return f"({args[0]} < {args[1]}) ? {args[0]} : {args[1]}"
            case Larger():
                return f"({args[0]} > {args[1]}) ? {args[0]} : {args[1]}"
            case Choose(relation):
                left, right, then, otherwise = args
                return f"({left} {relation.value} {right}) ? {then} : {otherwise}"
            case Lookup(first, bits, values):
                known = len(self.tables)
                table = self.tables.setdefault(values, f"{self.prefix}_table_{known + 1}")
                place = f"{args[0]} - {self._literal(first)}"
                return f"{self.prefix}_interpolated({table}, {place}, {bits}U)"
            case Literal() | ReadWord() | ReadMemory():
                return self._inline(node)
            case _:
                assert_never(node.op)

    def _operand(self, index: int) -> str:
        text = self.value(index)
        return f"({text})" if text.startswith(f"({self.prefix}_sum_t)") else text

    def _sum(self, constant: int, coefficients: Sequence[int], args: Sequence[str]) -> str:
        text = self._literal(constant) if constant else ""
        for coefficient, arg in zip(coefficients, args, strict=True):
            size = abs(coefficient)
            term = arg if size == 1 else f"({self._literal(size)} * {arg})"
            sign = "-" if coefficient < 0 else "+"
            if text:
                text = f"{text} {sign} {term}"
            else:
                text = f"-{term}" if coefficient < 0 else term
        return text
