"""Defines the subset of C in generated code, as a tree for the printer.

Numbers have no size here: the printer gives every literal and declaration the type of the program
(`float` or `double`, in fixed point words and sums), so that sizes are never mixed. Files that
build much of it import it as `c`, so that C nodes are easy to recognise.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum
from typing import Any, cast


class CType(Enum):
    """The type of a scalar or of array elements. REAL is the program's real type, STATUS that of
    status bits, WIDE has 64 bits. In fixed point WORD is the type of values, SUM that of sums, and
    BITS is unsigned with the size of a sum.
    """

    REAL = "real"
    BOOL = "bool"
    UNSIGNED = "uint32_t"
    WIDE = "uint64_t"
    STATUS = "status"
    WORD = "word"
    SUM = "sum"
    BITS = "bits"


# ---- expressions


@dataclass(frozen=True, slots=True)
class Name:
    """A variable, argument or macro, by its name."""

    text: str


@dataclass(frozen=True, slots=True)
class Real:
    """A literal of the program's real type, rounded to it; ±inf and NaN are allowed."""

    value: float


@dataclass(frozen=True, slots=True)
class Integer:
    """A literal in fixed-point code, of the type of sums."""

    value: int


@dataclass(frozen=True, slots=True)
class Unsigned:
    """An unsigned literal like `5U`, or `5ULL` if it is wide (64 bits)."""

    value: int
    wide: bool = False


@dataclass(frozen=True, slots=True)
class Truth:
    """`true` or `false`."""

    value: bool


@dataclass(frozen=True, slots=True)
class Member:
    """`base->field`, or `base.field` if `base` is not a pointer."""

    base: str
    field: str
    pointer: bool = True


@dataclass(frozen=True, slots=True)
class Element:
    """`array[index]`."""

    array: Expression
    index: Expression


@dataclass(frozen=True, slots=True)
class Unary:
    """`-x`, `!x`, `&x` or `*x`."""

    operator: str
    operand: Expression


@dataclass(frozen=True, slots=True)
class Binary:
    """`left operator right`; operands that are themselves binary are printed in parentheses."""

    operator: str
    left: Expression
    right: Expression


@dataclass(frozen=True, slots=True)
class Conditional:
    """`condition ? then : otherwise`."""

    condition: Expression
    then: Expression
    otherwise: Expression


@dataclass(frozen=True, slots=True)
class Convert:
    """`(type)operand`, a cast."""

    type: CType
    operand: Expression


@dataclass(frozen=True, slots=True)
class Call:
    """`function(arguments)`."""

    function: str
    arguments: tuple[Expression, ...]


Expression = (
    Name
    | Real
    | Integer
    | Unsigned
    | Truth
    | Member
    | Element
    | Unary
    | Binary
    | Conditional
    | Convert
    | Call
)


# ---- statements


@dataclass(frozen=True, slots=True)
class Declare:
    """The declaration of a local variable: a scalar (`size` None) with its initial value, or an
    array of `size` elements, optionally with their values.
    """

    type: CType
    name: str
    value: Expression | None = None
    size: int | None = None
    elements: tuple[Expression, ...] = ()
    constant: bool = False
    volatile: bool = False
    static: bool = False


@dataclass(frozen=True, slots=True)
class ConstantTable:
    """A constant array, local to its function, with elements of `type`."""

    name: str
    values: tuple[float, ...]
    type: CType = CType.REAL
    hexadecimal: bool = False
    """True for exact hexadecimal literals, for data that nobody reads."""


@dataclass(frozen=True, slots=True)
class Assign:
    """`target = value;`."""

    target: Expression
    value: Expression


@dataclass(frozen=True, slots=True)
class SetBits:
    """`target |= bits;`."""

    target: Expression
    bits: Expression


@dataclass(frozen=True, slots=True)
class Evaluate:
    """A statement that evaluates an expression, such as a call without result."""

    value: Expression


@dataclass(frozen=True, slots=True)
class Discard:
    """`(void)name;`, which prevents the warning of an unused argument."""

    name: str


@dataclass(frozen=True, slots=True)
class Loop:
    """`for (variable = start; variable < stop; variable += step)`, all of uint32_t."""

    variable: str
    start: int
    stop: int
    body: tuple[Statement, ...]
    step: int = 1


@dataclass(frozen=True, slots=True)
class If:
    """`if (condition) {then} else {otherwise}`; a single `If` as `otherwise` is printed as `else
    if`.
    """

    condition: Expression
    then: tuple[Statement, ...]
    otherwise: tuple[Statement, ...] = ()


@dataclass(frozen=True, slots=True)
class Return:
    """`return value;`."""

    value: Expression


@dataclass(frozen=True, slots=True)
class Comment:
    """A C comment on a line of its own; no text can end it early."""

    text: str


# closed unions: pyright reports each `match` that forgets a new kind
Statement = (
    Declare | ConstantTable | Assign | SetBits | Evaluate | Discard | Loop | If | Return | Comment
)


# ---- declarations


@dataclass(frozen=True, slots=True)
class Argument:
    """An argument of a C function, with its type as text: `const veh_in_t *`."""

    type: str
    name: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Function:
    """The definition of a C function. `result` is its return type as text, `doc` its comment."""

    name: str
    result: str
    arguments: tuple[Argument, ...]
    body: tuple[Statement, ...]
    doc: str = ""
    static: bool = False
    inline: bool = False


def used_names(statements: Iterable[Statement]) -> frozenset[str]:
    """The texts of all `Name`s in the statements, at any depth: variables and macros that they
    use.
    """
    found = set[str]()
    waiting: list[Any] = [*statements]
    while waiting:
        part = waiting.pop()
        if isinstance(part, Name):
            found.add(part.text)
        elif isinstance(part, tuple):
            waiting.extend(cast("tuple[Any, ...]", part))
        elif dataclasses.is_dataclass(part):
            waiting.extend(getattr(part, field.name) for field in dataclasses.fields(part))
    return frozenset(found)
