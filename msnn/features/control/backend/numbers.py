"""Formats C literals, initialisers and comments for one floating-point type."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from backends.c_language.layout import comment
from backends.c_language.literals import Dtype, real_literal
from compiler.kernels.tables.formats import RealName


@dataclass(frozen=True, slots=True)
class TypedLiterals:
    """Formatter of C literals of one floating-point type."""

    dtype: Dtype

    @property
    def real(self) -> RealName:
        """The name of the type in C."""
        return "float" if self.dtype == "float32" else "double"

    def literal(self, value: float) -> str:
        """Returns a C literal that reads back as the value rounded to the type."""
        return real_literal(float(value), self.dtype)

    def braced(self, values: Iterable[float]) -> str:
        """Returns the initialiser of a C array; ints become integer literals."""
        texts = (str(x) if isinstance(x, int) else self.literal(x) for x in values)
        return "{" + ", ".join(texts) + "}"

    def comment(self, text: str) -> str:
        """Returns a C comment, wrapped to lines."""
        return comment(text)
