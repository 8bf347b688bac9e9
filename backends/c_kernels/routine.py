"""Translates one math kernel, recorded as a routine, to a C function.

A value with one use is written at its use; others are named. The text satisfies strict warnings and
MISRA checkers: one declaration and one statement per line, no nested ?:, no implicit conversions,
casts of plain variables only, unsigned literals with U, complete else branches, one exit.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from typing import assert_never

from backends.c_language import tree as c
from backends.c_language.literals import suffix
from backends.c_language.printer import Printer
from compiler.kernels.trace import statements as traced
from compiler.kernels.trace.statements import (
    Assign,
    Binary,
    Block,
    Branch,
    Call,
    Constant,
    Convert,
    Function,
    Local,
    Lookup,
    Operand,
    Operation,
    Operator,
    Routine,
    Select,
    Statement,
    Table,
    Unary,
    ValueKind,
)

INLINE_LENGTH = 50
"""Maximum number of characters of a value that is written at its use."""

_TYPES = {
    ValueKind.REAL: c.CType.REAL,
    ValueKind.UNSIGNED: c.CType.UNSIGNED,
    ValueKind.WIDE: c.CType.WIDE,
    ValueKind.TRUTH: c.CType.BOOL,
}


class RoutineLowering:
    """Translates one routine, a traced math kernel, to C for one printer. After `function`,
    `needs_math` is True if the C calls <math.h>, and `choices` has the names of the functions of
    `constant_time` that it calls.
    """

    def __init__(self, routine: Routine, printer: Printer) -> None:
        self.routine = routine
        self.printer = printer
        self.needs_math = False
        self.choices: set[str] = set()
        self.uses = Counter(operands(routine.body))
        self._plain = set(plain_operands(routine.body))
        self._whole = set(branch_values(routine.body))
        self._names = {local.index: local.hint for local in routine.parameters}
        self._taken = set(self._names.values())
        if len(routine.results) > 1:
            self._taken |= set(routine.results)
        self._inlined: dict[int, c.Expression] = {}
        self._tables: dict[str, c.ConstantTable] = {}

    def function(self, *, public: bool = False) -> c.Function:
        """The C function; several results are returned through pointers. It is static unless
        `public`.
        """
        routine, type = self.routine, self.printer.type
        body, values = self.block(routine.body)
        kinds = [self.type(value.kind) for value in routine.body.values]
        arguments = [c.Argument(type(c.CType.REAL), self.name(x)) for x in routine.parameters]
        if len(values) == 1:
            result = type(kinds[0])
            body.append(c.Return(values[0]))
        else:
            result = "void"
            named = list(zip(routine.results, kinds, strict=True))
            # several results are returned through pointers
            arguments += [c.Argument(f"{type(kind)} *", name) for name, kind in named]
            targets = [c.Unary("*", c.Name(name)) for name in routine.results]
            body += [c.Assign(target, value) for target, value in zip(targets, values, strict=True)]
        return c.Function(
            name=self._called(routine),
            result=result,
            arguments=tuple(arguments),
            body=(*self._tables.values(), *body),
            doc=routine.doc,
            static=not public,
        )

    def block(self, block: Block) -> tuple[list[c.Statement], list[c.Expression]]:
        """The C statements of a block, and the expressions of its values, which are valid after
        them.
        """
        body = [made for statement in block.statements for made in self._statement(statement)]
        return body, [self.operand(value) for value in block.values]

    def _statement(self, statement: Statement) -> list[c.Statement]:
        match statement:
            case Assign(target, operation):
                return self._assign(target, operation)
            case Call(targets, routine, arguments):
                return self._call(targets, routine, [self.operand(each) for each in arguments])
            case Branch():
                return self.branch(statement)
            case _:
                assert_never(statement)

    def _assign(self, target: Local, operation: Operation) -> list[c.Statement]:
        value = self._operation(operation, target.kind)
        if self.inlines(target, operation, value):
            self._inlined[target.index] = value
            return []
        return [self._declared(target, value)]

    def inlines(self, target: Local, operation: Operation, value: c.Expression) -> bool:
        """True if the expression `value` of `target` is written where it is used, without a
        variable.
        """
        # named values stay visible; a value used twice would be computed twice
        if target.hint or self.uses[target] != 1:
            return False
        # these must be plain or negated variables
        if target in self._plain and not isinstance(operation, Unary):
            return False
        if target in self._whole:
            return True
        short = len(self.printer.operand(value)) <= INLINE_LENGTH
        return short and not isinstance(operation, Select | Lookup)

    def _declared(self, target: Local, value: c.Expression) -> c.Statement:
        return c.Declare(self.type(target.kind), self.name(target), value, constant=True)

    def _call(
        self, targets: tuple[Local, ...], routine: Routine, arguments: list[c.Expression]
    ) -> list[c.Statement]:
        name = self._called(routine)
        if len(targets) == 1:
            return [self._declared(targets[0], c.Call(name, tuple(arguments)))]
        # no initial values, so that analysers find a result that the call does not write
        declared = [c.Declare(self.type(target.kind), self.name(target)) for target in targets]
        results = [c.Unary("&", c.Name(self.name(target))) for target in targets]
        return [*declared, c.Evaluate(c.Call(name, (*arguments, *results)))]

    def _called(self, routine: Routine) -> str:
        return f"{self.printer.prefix}_{routine.name}"

    def branch(self, branch: Branch) -> list[c.Statement]:
        """C statements of a branch: declarations of its results, and an `if` whose blocks assign
        them.
        """
        declared = [c.Declare(self.type(x.kind), self.name(x)) for x in branch.targets]
        return [*declared, self._choice(branch)]

    def _choice(self, branch: Branch) -> c.If:
        condition = self.operand(branch.condition)
        then = self._arm(branch.then, branch.targets)
        return c.If(condition, then, self._arm(branch.otherwise, branch.targets))

    def _arm(self, block: Block, targets: tuple[Local, ...]) -> tuple[c.Statement, ...]:
        """The C statements of one block of a branch, which assign its values to `targets`. A branch
        at the end of the block assigns them directly.
        """
        last = block.statements[-1] if block.statements else None
        if isinstance(last, Branch) and last.targets == block.values:
            body, _ = self.block(Block(block.statements[:-1], ()))
            # an `else if`: the inner branch assigns the same variables without copies
            for inner, outer in zip(last.targets, targets, strict=True):
                self._names[inner.index] = self.name(outer)
            return (*body, self._choice(last))
        body, values = self.block(block)
        names = (c.Name(self.name(target)) for target in targets)
        return (*body, *(c.Assign(name, x) for name, x in zip(names, values, strict=True)))

    def name(self, local: Local) -> str:
        """The name of a variable in C: its hint, or `t1`, `t2`, …, unique in the function."""
        if local.index not in self._names:
            base, number = local.hint or "t", 1
            name = local.hint or "t1"
            while name in self._taken:
                number += 1
                name = f"{base}_{number}" if local.hint else f"t{number}"
            self._taken.add(name)
            self._names[local.index] = name
        return self._names[local.index]

    def type(self, kind: ValueKind) -> c.CType:
        """The C type of values of that kind."""
        return _TYPES[kind]

    def operand(self, operand: Operand) -> c.Expression:
        """The C expression of an operand: a variable, an expression written at its use, or a
        literal.
        """
        match operand:
            case Local(index):
                return self._inlined.get(index) or c.Name(self.name(operand))
            case Constant(kind, value):
                return self.constant(kind, value)
            case _:
                assert_never(operand)

    def constant(self, kind: ValueKind, value: float) -> c.Expression:
        match kind:
            case ValueKind.REAL:
                return c.Real(float(value))
            case ValueKind.UNSIGNED | ValueKind.WIDE:
                return c.Unsigned(int(value), wide=kind is ValueKind.WIDE)
            case ValueKind.TRUTH:
                return c.Truth(bool(value))
            case _:
                assert_never(kind)

    def _operation(self, operation: Operation, kind: ValueKind) -> c.Expression:
        match operation:
            case Unary(function, operand):
                return self._unary(function, self.operand(operand))
            case Binary(operator, left, right):
                return self.binary(operator, left, right)
            case Select(condition, then, otherwise):
                return self.select(kind, *map(self.operand, (condition, then, otherwise)))
            case Convert(operand):
                return c.Convert(self.type(kind), self.operand(operand))
            case Lookup(table, index):
                return self._look_up(table, self.operand(index))
            case _:
                assert_never(operation)

    def _unary(self, function: Function, operand: c.Expression) -> c.Expression:
        match function:
            case Function.NEGATE:
                return c.Unary("-", operand)
            case Function.NOT:
                return self.opposite(operand)
            case Function.MAGNITUDE:
                return self.library("abs", operand)
            case Function.SQUARE_ROOT:
                return self.library("sqrt", operand)
            case _:
                assert_never(function)

    def opposite(self, condition: c.Expression) -> c.Expression:
        return c.Unary("!", condition)

    def library(self, function: str, operand: c.Expression) -> c.Expression:
        """A call of a function of <math.h> in the type of the kernel, such as `sqrtf`."""
        self.needs_math = True
        name = {"abs": "fabs"}.get(function, function)
        return c.Call(f"{name}{suffix(self.printer.dtype)}", (operand,))

    def binary(self, operator: Operator, left: Operand, right: Operand) -> c.Expression:
        first = self.operand(left)
        match operator, left, right:
            # x − 3 instead of x + -3: the same rounding, more readable
            case Operator.ADD, _, Constant(ValueKind.REAL, value) if value < 0.0:
                return c.Binary("-", first, c.Real(-value))
            case Operator.SUBTRACT, _, Constant(ValueKind.REAL, value) if value < 0.0:
                return c.Binary("+", first, c.Real(-value))
            case Operator.SHIFT_LEFT, Constant(ValueKind.UNSIGNED, _), _:
                # a literal alone has only 16 bits on some targets
                first = c.Convert(c.CType.UNSIGNED, first)
            case _:
                pass
        return c.Binary(operator.value, first, self.operand(right))

    def select(
        self, kind: ValueKind, condition: c.Expression, then: c.Expression, otherwise: c.Expression
    ) -> c.Expression:
        """The C expression with one of two values of that kind, chosen by the condition; both are
        computed.
        """
        return c.Conditional(condition, then, otherwise)

    def _look_up(self, table: Table, index: c.Expression) -> c.Expression:
        # by name, so that a table is defined once
        made = c.ConstantTable(table.name, table.values, self.type(table.kind))
        self._tables[table.name] = made
        return self.entry(made, index)

    def entry(self, table: c.ConstantTable, index: c.Expression) -> c.Expression:
        """The C expression of the table entry with this index."""
        return c.Element(c.Name(table.name), index)


def operands(block: traced.Block) -> Iterator[traced.Operand]:
    """Each operand in a block and its inner blocks, as often as it is used; the values of a block
    are uses too.
    """
    # results are uses too: otherwise the last statement would look unused
    yield from block.values
    for statement in block.statements:
        match statement:
            case traced.Assign(_, operation):
                yield from traced.operation_operands(operation)
            case traced.Call(_, _, arguments):
                yield from arguments
            case traced.Branch(_, condition, then, otherwise):
                yield condition
                yield from operands(then)
                yield from operands(otherwise)
            case _:
                assert_never(statement)


def branch_values(block: traced.Block) -> Iterator[traced.Operand]:
    """The values that blocks of branches assign to the results of the branch, also in inner
    blocks.
    """
    for statement in block.statements:
        if isinstance(statement, traced.Branch):
            for arm in (statement.then, statement.otherwise):
                yield from arm.values
                yield from branch_values(arm)


def plain_operands(block: traced.Block) -> Iterator[traced.Operand]:
    """The operands of casts and selections, also in inner blocks. In C they must be variables or
    negated variables, not larger expressions.
    """
    for statement in block.statements:
        match statement:
            case traced.Assign(_, traced.Convert(operand)):
                yield operand
            case traced.Assign(_, traced.Select(_, then, otherwise)):
                yield then
                yield otherwise
            case traced.Branch(_, _, then, otherwise):
                yield from plain_operands(then)
                yield from plain_operands(otherwise)
            case _:
                pass
