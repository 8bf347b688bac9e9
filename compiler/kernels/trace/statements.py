"""Defines the statements of a traced kernel, the one form that numpy evaluates and C is made of.

A routine is straight-line code in single assignment with structured branches. Every operation is
exact or correctly rounded by IEEE 754, so that executing the same statements in the same order
gives the same bits everywhere.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import assert_never

from compiler.kernels.tables.formats import Format


class ValueKind(Enum):
    """The type of a value; REAL is the format of the routine."""

    REAL = "real"
    UNSIGNED = "uint32"
    WIDE = "uint64"
    TRUTH = "bool"


class Operator(Enum):
    """Two-operand operations; those on integers wrap modulo 2^32 or 2^64."""

    ADD = "+"
    SUBTRACT = "-"
    MULTIPLY = "*"
    DIVIDE = "/"
    SHIFT_LEFT = "<<"
    SHIFT_RIGHT = ">>"
    BITS_AND = "&"
    BITS_OR = "|"
    LESS = "<"
    LESS_EQUAL = "<="
    GREATER = ">"
    GREATER_EQUAL = ">="
    BOTH = "&&"
    EITHER = "||"


# there is no equality, which would depend on rounding
COMPARISONS = frozenset(
    {Operator.LESS, Operator.LESS_EQUAL, Operator.GREATER, Operator.GREATER_EQUAL}
)


class Function(Enum):
    """One-operand operations, exact or correctly rounded."""

    NEGATE = "negate"
    MAGNITUDE = "magnitude"
    SQUARE_ROOT = "square root"
    NOT = "not"


@dataclass(frozen=True, slots=True)
class Local:
    """A value of the routine; `hint` is its name in the C text, empty for a nameless one."""

    index: int
    kind: ValueKind
    hint: str


@dataclass(frozen=True, slots=True)
class Constant:
    """A number, exactly representable in its kind."""

    kind: ValueKind
    value: float | int


Operand = Local | Constant


@dataclass(frozen=True, slots=True)
class Table:
    """Constant numbers that are looked up by index."""

    name: str
    kind: ValueKind
    values: tuple[float, ...] | tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Unary:
    """function(operand)."""

    function: Function
    operand: Operand


@dataclass(frozen=True, slots=True)
class Binary:
    """left operator right, both of one kind."""

    operator: Operator
    left: Operand
    right: Operand


@dataclass(frozen=True, slots=True)
class Select:
    """`then` where the condition holds, else `otherwise`; both are already computed."""

    condition: Operand
    then: Operand
    otherwise: Operand


@dataclass(frozen=True, slots=True)
class Convert:
    """The operand in the target's kind: reals are truncated to integers, 64 bits to the low 32.

    The kernel checks the range of a real before it converts it.
    """

    operand: Operand


@dataclass(frozen=True, slots=True)
class Lookup:
    """table[index]; the kernel checks the range of the index."""

    table: Table
    index: Operand


Operation = Unary | Binary | Select | Convert | Lookup


def operation_operands(operation: Operation) -> tuple[Operand, ...]:
    """The operands in the order of the formula."""
    match operation:
        case Unary(_, operand) | Convert(operand) | Lookup(_, operand):
            return (operand,)
        case Binary(_, left, right):
            return (left, right)
        case Select(condition, then, otherwise):
            return (condition, then, otherwise)
        case _:
            assert_never(operation)


@dataclass(frozen=True, slots=True)
class Assign:
    """target = operation."""

    target: Local
    operation: Operation


@dataclass(frozen=True, slots=True)
class Call:
    """targets = routine(arguments)."""

    targets: tuple[Local, ...]
    routine: Routine
    arguments: tuple[Operand, ...]


@dataclass(frozen=True, slots=True)
class Branch:
    """targets = the values of the block that the condition chooses; the other is not executed."""

    targets: tuple[Local, ...]
    condition: Operand
    then: Block
    otherwise: Block


Statement = Assign | Call | Branch


@dataclass(frozen=True, slots=True)
class Block:
    """Statements in order, and the operands that hold the block's values after them."""

    statements: tuple[Statement, ...]
    values: tuple[Operand, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Routine:
    """A traced function of reals; `results` has one name per value."""

    name: str
    doc: str
    format: Format
    parameters: tuple[Local, ...]
    results: tuple[str, ...]
    body: Block
