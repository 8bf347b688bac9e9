"""Prints the C tree with vectors instead of reals: one lane per rollout."""

from __future__ import annotations

from collections.abc import Iterable

from backends.c_language import tree as c
from backends.c_language.printer import Printer
from backends.native.arrangement.tiled_sums import HORIZON, TimeLoop


class LanePrinter(Printer):
    """Prints like the printer of controllers, with vectors for reals and masks for bools.

    Vector extensions of gcc and clang have no literals and, in C, no `?:`. The kernel's prelude
    defines `splat` and `choose` instead.
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
        """A constant array with every value in all lanes."""
        numbers = [f"all({self.number(value)})" for value in table.values]
        head = f"static const lanes {table.name}[{len(numbers)}]"
        return f"{head} = {self.braced(numbers)};"
