"""Lowers math kernels for a group of lanes: both sides of a branch, then a selection.

A side that no lane takes is skipped, so that rare cases (angles beyond 2^17) cost nothing.
"""

from __future__ import annotations

from collections.abc import Iterable

from backends.c_kernels.printer import KernelPrinter, dtype_of
from backends.c_kernels.routine import RoutineLowering
from backends.c_kernels.sources import callees_first
from backends.c_language import tree as c
from backends.native.lanes.fused_products import with_fused_products
from backends.native.lanes.lane_printer import LanePrinter
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
    """Definitions of the kernels and the functions that they call, callees first."""
    printer = LaneKernelPrinter(prefix, dtype_of(format))
    lowered = (_LaneLowering(routine, printer) for routine in callees_first(names, format))
    return "\n".join(printer.function(with_fused_products(each.function())) for each in lowered)


class LaneKernelPrinter(LanePrinter):
    """Prints functions whose integers are vectors with one lane per sample as well."""

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
        """A constant array from which each lane reads its own entry."""
        return KernelPrinter(self.prefix, self.dtype).table(table)


class _LaneLowering(RoutineLowering):
    """Every value is a variable, except products that may be fused with their sum."""

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
        """One entry per lane; lanes that do not take this side read entry 0."""
        arguments = (c.Name(table.name), c.Integer(len(table.values)), index)
        return c.Call(_LOOK_UPS[table.type], arguments)
