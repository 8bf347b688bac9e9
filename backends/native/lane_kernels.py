"""Prints the C tree and math kernels for a group of lanes: vectors instead of reals."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import assert_never

from backends.c_kernels.routine import RoutineLowering
from backends.c_kernels.sources import KernelPrinter, callees_first, dtype_of
from backends.c_language import tree as c
from backends.c_language.printer import Printer
from backends.native.tiled_sums import HORIZON, TimeLoop
from compiler.kernels.tables.formats import Format
from compiler.kernels.trace.statements import (
    COMPARISONS,
    Binary,
    Branch,
    Constant,
    Local,
    Operand,
    Operation,
    Operator,
    ValueKind,
)

FUSED = "fused"
"""a · b + c rounded once; defined in the kernel's prelude."""


def with_fused_products(function: c.Function) -> c.Function:
    """The function with `fused(a, b, c)`, a·b + c rounded once, for every sum or difference that
    has a product as a term. Of two products the right one is fused: a·b + c·d becomes fused(c, d,
    a·b).
    """
    return replace(function, body=_block(function.body))


def _block(statements: tuple[c.Statement, ...]) -> tuple[c.Statement, ...]:
    return tuple(map(_statement, statements))


def _statement(statement: c.Statement) -> c.Statement:
    match statement:
        case c.Declare(value=value, elements=elements):
            value = None if value is None else _expression(value)
            return replace(statement, value=value, elements=tuple(map(_expression, elements)))
        case c.Assign() | c.Evaluate() | c.Return():
            return replace(statement, value=_expression(statement.value))
        case c.Loop():
            return replace(statement, body=_block(statement.body))
        case c.If(condition, then, otherwise):
            return c.If(_expression(condition), _block(then), _block(otherwise))
        case c.ConstantTable() | c.SetBits() | c.Discard() | c.Comment():
            return statement
        case _:
            assert_never(statement)


def _expression(expression: c.Expression) -> c.Expression:
    match expression:
        case c.Binary("+" | "-" as operator, left, right):
            negative = operator == "-"
            # a − b·c is fused(−b, c, a): negation is exact
            if (factors := _factors(right, negative=negative)) is not None:
                return c.Call(FUSED, (*factors, _expression(left)))
            if (factors := _factors(left)) is not None:
                added = _expression(right)
                # a·b − c is fused(a, b, −c)
                return c.Call(FUSED, (*factors, c.Unary("-", added) if negative else added))
            return c.Binary(operator, _expression(left), _expression(right))
        case c.Binary(operator, left, right):
            return c.Binary(operator, _expression(left), _expression(right))
        case c.Unary() | c.Convert():
            return replace(expression, operand=_expression(expression.operand))
        case c.Conditional(condition, then, otherwise):
            return c.Conditional(_expression(condition), _expression(then), _expression(otherwise))
        case c.Call(function, arguments):
            return c.Call(function, tuple(map(_expression, arguments)))
        case (
            c.Name() | c.Real() | c.Integer() | c.Unsigned() | c.Truth() | c.Member() | c.Element()
        ):
            return expression
        case _:
            assert_never(expression)


def _factors(
    expression: c.Expression, *, negative: bool = False
) -> tuple[c.Expression, c.Expression] | None:
    """Two factors whose product is the expression, or its negative if `negative`; None for an
    expression that is no product.
    """
    match expression:
        case c.Unary("-", operand):
            return _factors(operand, negative=not negative)
        case c.Binary("*", left, right):
            # the sign moves to a factor: −(a·b) and (−a)·b round identically
            first = _expression(left)
            return c.Unary("-", first) if negative else first, _expression(right)
        case _:
            return None


class LanePrinter(Printer):
    """Prints C for SIMD vectors: `lanes` instead of reals, `mask` instead of bools. Vector
    extensions of gcc and clang have no literals and, in C, no `?:`; the kernel's prelude defines
    `splat` and `choose` instead.
    """

    def type(self, type: c.CType) -> str:
        match type:
            case c.CType.REAL:
                return "lanes"
            case c.CType.BOOL:
                return "mask"
            case c.CType.UNSIGNED | c.CType.STATUS:
                return "uint32_t"
            case c.CType.WIDE | c.CType.WORD | c.CType.SUM | c.CType.BITS:
                return super().type(type)

    def expression(self, expression: c.Expression) -> str:
        match expression:
            case c.Real(value):
                return f"splat({self.number(value)})"
            case c.Truth(value):
                return "every_lane" if value else "no_lane"
            case c.Conditional(condition, then, otherwise):
                parts = (self.expression(part) for part in (condition, then, otherwise))
                return f"choose({', '.join(parts)})"
            case _:
                return super().expression(expression)

    def operand(self, expression: c.Expression) -> str:
        match expression:
            case c.Real() | c.Conditional():
                return self.expression(expression)
            case _:
                return super().operand(expression)

    def statement(self, statement: c.Statement) -> Iterable[str]:
        match statement:
            case TimeLoop(variable=time, stop=step, body=body, rest=rest):
                # the remaining samples after the last full iteration
                begin = f"{HORIZON} - ({HORIZON} % {step}U)" if rest else "0"
                stop = (
                    # not HORIZON - step, which underflows for a short horizon
                    f"{time} < {HORIZON}" if rest or step == 1 else f"{time} + {step} <= {HORIZON}"
                )
                by = 1 if rest else step
                yield f"for (size_t {time} = {begin}; {stop}; {time} += {by}) {{"
            case c.Loop(variable, start, stop, body, step):
                by = "++" if step == 1 else f" += {step}"
                yield f"for (size_t {variable} = {start}; {variable} < {stop}; {variable}{by}) {{"
            case _:
                yield from super().statement(statement)
                return
        yield from self._block(body, 1)
        yield "}"

    def table(self, table: c.ConstantTable) -> str:
        """The definition of a constant array whose elements are vectors with the value in all
        lanes.
        """
        numbers = [f"all({self.number(value)})" for value in table.values]
        head = f"static const lanes {table.name}[{len(numbers)}]"
        return f"{head} = {self.braced(numbers)};"


_CHOICES = {
    ValueKind.REAL: "choose",
    ValueKind.UNSIGNED: "choose_word",
    ValueKind.WIDE: "choose_wide",
    ValueKind.TRUTH: "choose_mask",
}
_LOOK_UPS = {c.CType.REAL: "look_up", c.CType.UNSIGNED: "look_up_word"}
_LOGICAL = {Operator.BOTH: "&", Operator.EITHER: "|"}
_SHIFTS = (Operator.SHIFT_LEFT, Operator.SHIFT_RIGHT)


def lane_kernels(names: Iterable[str], format: Format, prefix: str) -> str:
    """C definitions of the math kernels with these names, and of the functions that they call
    before them. `format` is the floating-point format, `prefix` that of C names.
    """
    printer = LaneKernelPrinter(prefix, dtype_of(format))
    lowered = (_LaneLowering(routine, printer) for routine in callees_first(names, format))
    return "\n".join(printer.function(with_fused_products(each.function())) for each in lowered)


class LaneKernelPrinter(LanePrinter):
    """Prints math kernels, in which integers are vectors too, with one lane per rollout."""

    exact = True

    def type(self, type: c.CType) -> str:
        match type:
            case c.CType.UNSIGNED:
                return "words"
            case c.CType.WIDE:
                return "wides"
            case _:
                return super().type(type)

    def expression(self, expression: c.Expression) -> str:
        match expression:
            case c.Unsigned(_, wide):
                return f"splat_{'wide' if wide else 'word'}({super().expression(expression)})"
            case c.Convert(type, operand):
                return f"__builtin_convertvector({self.expression(operand)}, {self.type(type)})"
            case _:
                return super().expression(expression)

    def operand(self, expression: c.Expression) -> str:
        if isinstance(expression, c.Convert):
            return self.expression(expression)
        return super().operand(expression)

    def table(self, table: c.ConstantTable) -> str:
        """The definition of a constant array of scalars, from which each lane reads its own
        entry.
        """
        return KernelPrinter(self.prefix, self.dtype).table(table)


class _LaneLowering(RoutineLowering):
    """Translates a math kernel to C on vectors. A branch computes both sides and selects per lane.
    Every value is a variable, except products that may be fused with their sum.
    """

    def name(self, local: Local) -> str:
        return f"v{local.index}"

    def inlines(self, target: Local, operation: Operation, value: c.Expression) -> bool:
        # only if used once: otherwise the product would be computed twice
        product = isinstance(operation, Binary) and operation.operator is Operator.MULTIPLY
        return product and target.kind is ValueKind.REAL and self.uses[target] == 1

    def branch(self, branch: Branch) -> list[c.Statement]:
        condition = self.operand(branch.condition)
        made: list[c.Statement] = [
            c.Declare(self.type(x.kind), self.name(x), self.constant(x.kind, 0))
            for x in branch.targets
        ]
        for taken, block in (
            (condition, branch.then),
            (self.opposite(condition), branch.otherwise),
        ):
            body, values = self.block(block)
            for target, value in zip(branch.targets, values, strict=True):
                name = c.Name(self.name(target))
                # lanes that do not take this side keep their value
                body.append(c.Assign(name, self.select(target.kind, taken, value, name)))
            # in this order: the second side selects between its value and that of the first
            made.append(c.If(c.Call("any_lane", (taken,)), tuple(body)))
        return made

    def opposite(self, condition: c.Expression) -> c.Expression:
        return c.Unary("~", condition)

    def library(self, function: str, operand: c.Expression) -> c.Expression:
        return c.Call(f"lane_{function}", (operand,))

    def binary(self, operator: Operator, left: Operand, right: Operand) -> c.Expression:
        first, second, kind = self.operand(left), self.operand(right), left.kind
        if operator in _SHIFTS:
            # lanes that do not take this side can have any shift count
            limit = Constant(kind, 63 if kind is ValueKind.WIDE else 31)
            second = c.Binary("&", second, self.operand(limit))
        result = c.Binary(_LOGICAL.get(operator, operator.value), first, second)
        # a mask of words has the size of words, a mask of lanes that of reals
        if operator in COMPARISONS and kind is not ValueKind.REAL:
            return c.Convert(c.CType.BOOL, result)
        return result

    def select(
        self, kind: ValueKind, condition: c.Expression, then: c.Expression, otherwise: c.Expression
    ) -> c.Expression:
        return c.Call(_CHOICES[kind], (condition, then, otherwise))

    def entry(self, table: c.ConstantTable, index: c.Expression) -> c.Expression:
        """C call that reads one table entry per lane, at the lane's index; lanes that do not take
        the current branch read entry 0.
        """
        arguments = (c.Name(table.name), c.Integer(len(table.values)), index)
        return c.Call(_LOOK_UPS[table.type], arguments)
