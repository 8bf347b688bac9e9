"""Spells numbers and lists of them in C, of the controller's type."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from backends.c_language.layout import comment
from backends.c_language.literals import Dtype, real_literal
from compiler.kernels.tables.formats import RealName


@dataclass(frozen=True, slots=True)
class TypedLiterals:
    """Literals of one type."""

    dtype: Dtype

    @property
    def real(self) -> RealName:
        """The type in C."""
        return "float" if self.dtype == "float32" else "double"

    def literal(self, value: float) -> str:
        """A literal that reads back as the value rounded to the type."""
        return real_literal(float(value), self.dtype)

    def braced(self, values: Iterable[float]) -> str:
        """The elements of an array: integers as they are, others as literals."""
        texts = (str(x) if isinstance(x, int) else self.literal(x) for x in values)
        return "{" + ", ".join(texts) + "}"

    def comment(self, text: str) -> str:
        """A comment of one or more lines."""
        return comment(text)
