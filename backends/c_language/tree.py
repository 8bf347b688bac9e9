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
    """Type of a scalar or of array elements.

    REAL is the program's real type; in fixed point WORD, SUM and BITS (unsigned, of the size of a
    sum) are its types.
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
    """A variable, parameter or macro."""

    text: str


@dataclass(frozen=True, slots=True)
class Real:
    """A literal of the program's real type, rounded to it; ±inf and NaN are allowed."""

    value: float


@dataclass(frozen=True, slots=True)
class Integer:
    """A literal of the type of sums in fixed point."""

    value: int


@dataclass(frozen=True, slots=True)
class Unsigned:
    """A literal like `5U`, or `5ULL` where it is wide."""

    value: int
    wide: bool = False


@dataclass(frozen=True, slots=True)
class Truth:
    """`true` or `false`."""

    value: bool


@dataclass(frozen=True, slots=True)
class Member:
    """`pointer->field`, or `value.field` of a struct."""

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
    """`(type)x` of a variable, an element, a literal or the result of a call."""

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
    """A local scalar (`size` None) with its value, or an array, optionally with its elements."""

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
    """A constant array of numbers, local to its function."""

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
    """An expression whose value is not used."""

    value: Expression


@dataclass(frozen=True, slots=True)
class Discard:
    """`(void)name;` for an unused parameter."""

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
    """A choice between blocks; a lone `If` as the other block is printed as `else if`."""

    condition: Expression
    then: tuple[Statement, ...]
    otherwise: tuple[Statement, ...] = ()


@dataclass(frozen=True, slots=True)
class Return:
    """`return value;`."""

    value: Expression


@dataclass(frozen=True, slots=True)
class Comment:
    """One comment line; any text is safe."""

    text: str


# closed unions: pyright reports each `match` that forgets a new kind
Statement = (
    Declare | ConstantTable | Assign | SetBits | Evaluate | Discard | Loop | If | Return | Comment
)


# ---- declarations


@dataclass(frozen=True, slots=True)
class Argument:
    """A parameter of a function with its type as text: `const veh_in_t *`."""

    type: str
    name: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Function:
    """A function definition; `result` is its return type as text."""

    name: str
    result: str
    arguments: tuple[Argument, ...]
    body: tuple[Statement, ...]
    doc: str = ""
    static: bool = False
    inline: bool = False


def used_names(statements: Iterable[Statement]) -> frozenset[str]:
    """The names of all variables in expressions of the statements."""
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
