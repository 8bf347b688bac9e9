"""Merges the scalar functions of the table with the other builtins of the language."""

from __future__ import annotations

from compiler.ir.scalars.table import SCALAR_FUNCTIONS
from spec_schema.expressions.language import (
    BUILTINS,
    LOSS_FUNCTIONS,
    NUMBERS,
    STATE_FUNCTIONS,
    TIME_NAMES,
    Signature,
)

SIGNATURES: dict[str, Signature] = {
    row.name: Signature(row.arity, row.arity, doc=row.doc) for row in SCALAR_FUNCTIONS.values()
} | BUILTINS
"""Every builtin function by name."""

OF_THE_LANGUAGE = frozenset({*TIME_NAMES, *NUMBERS, *STATE_FUNCTIONS, *SIGNATURES, *LOSS_FUNCTIONS})
"""Names with a fixed meaning in every spec, unless the spec declares them itself."""
