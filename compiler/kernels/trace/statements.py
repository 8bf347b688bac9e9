"""Defines the statements of a traced kernel, the one form that numpy evaluates and C is made of.

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


def drop_unused(block: Block) -> Block:
    """The block with only the statements that its values depend on.

    Before: any block. After: every target is used, except some of a call with several results. E.g.
    `a = x + 1; b = x · 2; values (b)` becomes `b = x · 2; values (b)`.
    """
    return _drop(block, set())


def _drop(block: Block, used: set[Operand]) -> Block:
    """Removes unused statements, and adds the operands of the others to `used`."""
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
    """The routine with both blocks of each branch, after which its values are selected.

    Before: any routine. After: the same bits and no branch, in the routines that it calls neither.
    What a block may take for granted where it is chosen no longer holds, so the arguments of
    operations that C leaves undefined are replaced by 0 where they are outside their range.
    E.g. `if x > 0 { y = table[n] } else { y = 0 }` becomes
    `i = n < 9 ? n : 0; t = table[i]; y = x > 0 ? t : 0`.
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
        """The number if it lies in 0 ≤ x < limit, else 0."""
        above = self._new(Binary(Operator.GREATER_EQUAL, real, _ZERO), ValueKind.TRUTH)
        below = self._new(
            Binary(Operator.LESS, real, Constant(ValueKind.REAL, limit)), ValueKind.TRUTH
        )
        inside = self._new(Binary(Operator.BOTH, above, below), ValueKind.TRUTH)
        return self._new(Select(inside, real, _ZERO), ValueKind.REAL)

    def _below(self, index: Local, limit: int) -> Operand:
        """The integer if it is less than the limit, else 0."""
        inside = self._new(
            Binary(Operator.LESS, index, Constant(index.kind, limit)), ValueKind.TRUTH
        )
        return self._new(Select(inside, index, Constant(index.kind, 0)), index.kind)

    def _root(self, real: Local) -> Operation:
        """√x without a library's detour below zero: there it is 0 / 0, elsewhere √x / 1."""
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
    """The parameters of a routine and every local that it assigns."""
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
