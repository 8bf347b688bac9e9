"""The statements of a traced kernel. numpy evaluates them, and the C code is generated from them.

A routine is straight-line code in single assignment with structured branches. Every operation is
exact or correctly rounded by IEEE 754, so that executing the same statements in the same order
gives the same bits everywhere.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum
from typing import assert_never

from compiler.kernels.tables.formats import Format


class ValueKind(Enum):
    """The type of a value; REAL is float or double, the format of the routine."""

    REAL = "real"
    UNSIGNED = "uint32"
    WIDE = "uint64"
    TRUTH = "bool"


class Operator(Enum):
    """Operations with two operands. Those on integers wrap around, modulo 2^32 or 2^64."""

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
    """Operations with one operand, exact or correctly rounded."""

    NEGATE = "negate"
    MAGNITUDE = "magnitude"
    SQUARE_ROOT = "square root"
    NOT = "not"


@dataclass(frozen=True, slots=True)
class Local:
    """A local variable of the routine, assigned once. `index` is its unique number, `hint` its name
    in the C code, empty for a generated one.
    """

    index: int
    kind: ValueKind
    hint: str


@dataclass(frozen=True, slots=True)
class Constant:
    """A number that its kind represents exactly."""

    kind: ValueKind
    value: float | int


Operand = Local | Constant


@dataclass(frozen=True, slots=True)
class Table:
    """An array of constants, read by index with `Lookup`; `name` is its name in the C code."""

    name: str
    kind: ValueKind
    values: tuple[float, ...] | tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Unary:
    """`function` applied to the operand."""

    function: Function
    operand: Operand


@dataclass(frozen=True, slots=True)
class Binary:
    """The result of `operator` for two operands of one kind, such as left + right."""

    operator: Operator
    left: Operand
    right: Operand


@dataclass(frozen=True, slots=True)
class Select:
    """`then` where the condition is true, else `otherwise`; both are computed before."""

    condition: Operand
    then: Operand
    otherwise: Operand


@dataclass(frozen=True, slots=True)
class Convert:
    """The operand converted to the kind of the variable that it is assigned to: reals are truncated
    to integers, 64-bit integers to their low 32 bits.

    The kernel checks the range of a real before it converts it.
    """

    operand: Operand


@dataclass(frozen=True, slots=True)
class Lookup:
    """The entry table[index]; the kernel ensures that the index is inside the table."""

    table: Table
    index: Operand


Operation = Unary | Binary | Select | Convert | Lookup


def operation_operands(operation: Operation) -> tuple[Operand, ...]:
    """The operands of an operation, in the order of its fields."""
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
    """Assigns the result of an operation to a new local variable."""

    target: Local
    operation: Operation


@dataclass(frozen=True, slots=True)
class Call:
    """Assigns the results of a call of `routine` to new local variables, one per result."""

    targets: tuple[Local, ...]
    routine: Routine
    arguments: tuple[Operand, ...]


@dataclass(frozen=True, slots=True)
class Branch:
    """Executes the block `then` if the condition is true, else `otherwise`, and assigns the values
    of that block to `targets`.
    """

    targets: tuple[Local, ...]
    condition: Operand
    then: Block
    otherwise: Block


Statement = Assign | Call | Branch


@dataclass(frozen=True, slots=True)
class Block:
    """Statements in order, and the operands that are the results of the block."""

    statements: tuple[Statement, ...]
    values: tuple[Operand, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Routine:
    """A traced function of reals: its parameters, its statements and the names of its results, one
    per value of the body.
    """

    name: str
    doc: str
    format: Format
    parameters: tuple[Local, ...]
    results: tuple[str, ...]
    body: Block


def drop_unused(block: Block) -> Block:
    """The block without the statements on which none of its values depends.

    A call with several results keeps all of them if one is used. Example: `a = x + 1; b = x · 2;
    values (b)` becomes `b = x · 2; values (b)`.
    """
    return _drop(block, set())


def _drop(block: Block, used: set[Operand]) -> Block:
    """The block without statements whose targets are not in `used`, the operands that later
    statements need. Adds the operands of the remaining statements to `used`.
    """
    used.update(block.values)
    kept: list[Statement] = []
    # backwards: users come after a value and have marked it
    for statement in reversed(block.statements):
        match statement:
            case Assign(target, operation):
                if target not in used:
                    continue
                used.update(operation_operands(operation))
                kept.append(statement)
            case Call(targets, _, arguments):
                # one used result keeps the call with all its results: C returns them together
                if used.isdisjoint(targets):
                    continue
                used.update(arguments)
                kept.append(statement)
            case Branch(targets, condition, then, otherwise):
                # unused values of a branch are removed, with the statements for them in both blocks
                wanted = [i for i, target in enumerate(targets) if target in used]
                if not wanted:
                    continue
                first = _drop(_keep_values(then, wanted), used)
                second = _drop(_keep_values(otherwise, wanted), used)
                used.add(condition)
                kept.append(Branch(tuple(targets[i] for i in wanted), condition, first, second))
            case _:
                assert_never(statement)
    return Block(tuple(reversed(kept)), block.values)


def _keep_values(block: Block, wanted: list[int]) -> Block:
    return Block(block.statements, tuple(block.values[i] for i in wanted))


_BITS = {ValueKind.UNSIGNED: 32, ValueKind.WIDE: 64}


def without_branches(routine: Routine) -> Routine:
    """The routine with the statements of both blocks of each branch, followed by a selection of the
    results; also in the routines that it calls. The results keep their bits.

    A block may rely on the condition under which it runs, which no longer holds. Arguments for
    which C leaves an operation undefined are therefore replaced by 0. Example: `if x > 0 { y =
    table[n] } else { y = 0 }` becomes `i = n < 9 ? n : 0; t = table[i]; y = x > 0 ? t : 0`.
    """
    return _Flattening(routine).result()


class _Flattening:
    def __init__(self, routine: Routine) -> None:
        self._routine = routine
        # numbers of new locals follow those of the routine
        self._count = max(local.index for local in _locals_within(routine))
        self._statements: list[Statement] = []

    def result(self) -> Routine:
        old = self._routine
        values = self._flatten(old.body)
        body = Block(tuple(self._statements), values)
        return Routine(
            name=old.name,
            doc=old.doc,
            format=old.format,
            parameters=old.parameters,
            results=old.results,
            body=body,
        )

    def _flatten(self, block: Block) -> tuple[Operand, ...]:
        for statement in block.statements:
            match statement:
                case Assign(target, operation):
                    guarded = self._guarded(operation, target.kind)
                    self._statements.append(Assign(target, guarded))
                case Call(targets, routine, arguments):
                    self._statements.append(Call(targets, without_branches(routine), arguments))
                case Branch(targets, condition, then, otherwise):
                    # both blocks run for every argument; their locals have unique numbers
                    first, second = self._flatten(then), self._flatten(otherwise)
                    for target, one, other in zip(targets, first, second, strict=True):
                        self._statements.append(Assign(target, Select(condition, one, other)))
                case _:
                    assert_never(statement)
        return block.values

    def _guarded(self, operation: Operation, kind: ValueKind) -> Operation:
        match operation:
            # a real beyond the integers, an index beyond a table, a shift by the width or more: C
            # leaves them undefined, and a block that is not chosen may now meet them
            case Convert(Local(_, ValueKind.REAL) as real):
                return Convert(self._within(real, 2.0 ** _BITS[kind]))
            case Lookup(table, Local() as index):
                return Lookup(table, self._below(index, len(table.values)))
            case Binary(Operator.SHIFT_LEFT | Operator.SHIFT_RIGHT as shift, value, Local() as by):
                return Binary(shift, value, self._below(by, _BITS[value.kind]))
            case Unary(Function.SQUARE_ROOT, Local() as radicand):
                return self._root(radicand)
            case _:
                return operation

    def _within(self, real: Local, limit: float) -> Operand:
        """Adds statements for `real` if 0 ≤ real < limit, else 0; returns the local of
        the result.
        """
        above = self._new(Binary(Operator.GREATER_EQUAL, real, _ZERO), ValueKind.TRUTH)
        below = self._new(
            Binary(Operator.LESS, real, Constant(ValueKind.REAL, limit)), ValueKind.TRUTH
        )
        inside = self._new(Binary(Operator.BOTH, above, below), ValueKind.TRUTH)
        return self._new(Select(inside, real, _ZERO), ValueKind.REAL)

    def _below(self, index: Local, limit: int) -> Operand:
        """Adds statements for `index` if it is less than the limit, else 0; returns the local of
        the result.
        """
        inside = self._new(
            Binary(Operator.LESS, index, Constant(index.kind, limit)), ValueKind.TRUTH
        )
        return self._new(Select(inside, index, Constant(index.kind, 0)), index.kind)

    def _root(self, real: Local) -> Operation:
        """The square root of `real`, without the error handling of a C library for negative
        arguments: there it is 0 / 0 (NaN), elsewhere √x / 1.
        """
        negative = self._new(Binary(Operator.LESS, real, _ZERO), ValueKind.TRUTH)
        radicand = self._new(Select(negative, _ZERO, real), ValueKind.REAL)
        root = self._new(Unary(Function.SQUARE_ROOT, radicand), ValueKind.REAL)
        divisor = self._new(Select(negative, _ZERO, _ONE), ValueKind.REAL)
        return Binary(Operator.DIVIDE, root, divisor)

    def _new(self, operation: Operation, kind: ValueKind) -> Local:
        self._count += 1
        target = Local(self._count, kind, "")
        self._statements.append(Assign(target, operation))
        return target


def _locals_within(routine: Routine) -> Iterator[Local]:
    """The parameters of a routine and every local variable that it assigns, in order."""
    yield from routine.parameters
    yield from _assigned(routine.body)


def _assigned(block: Block) -> Iterator[Local]:
    for statement in block.statements:
        match statement:
            case Assign(target, _):
                yield target
            case Call(targets, _, _):
                yield from targets
            case Branch(targets, _, then, otherwise):
                yield from targets
                yield from _assigned(then)
                yield from _assigned(otherwise)
            case _:
                assert_never(statement)


_ZERO, _ONE = Constant(ValueKind.REAL, 0.0), Constant(ValueKind.REAL, 1.0)
