"""Prints math kernels: reals have C's own types, constants are exact."""

from __future__ import annotations

from backends.c_language.literals import Dtype
from backends.c_language.printer import Printer
from backends.c_language.tree import Convert, Expression
from compiler.kernels.tables.formats import Format


class KernelPrinter(Printer):
    """The printer of a file that does not include the program's header."""

    exact = True

    @property
    def real(self) -> str:
        return "float" if self.dtype == "float32" else "double"

    def operand(self, expression: Expression) -> str:
        if isinstance(expression, Convert):
            return self.expression(expression)
        return super().operand(expression)


def dtype_of(format: Format) -> Dtype:
    """The dtype of a format, for printers."""
    return "float32" if format.c_type == "float" else "float64"
