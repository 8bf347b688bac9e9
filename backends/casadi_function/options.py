"""Options of an export to CasADi."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

Form: TypeAlias = Literal["mx", "sx"]


@dataclass(frozen=True, slots=True)
class CasadiOptions:
    """Options of an export to CasADi."""

    params: Literal["input", "inline"] = "input"
    """`input` makes parameters inputs of the functions, `inline` writes their values into them."""
    form: Form = "mx"
    """`mx` for expressions of arrays, `sx` for expressions of scalars."""
