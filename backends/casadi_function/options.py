"""Lists the choices that an export to CasADi leaves open."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

Form: TypeAlias = Literal["mx", "sx"]


@dataclass(frozen=True, slots=True)
class CasadiOptions:
    """Choices of one export."""

    params: Literal["input", "inline"] = "input"
    """Whether parameters are inputs of the functions or numbers in them."""
    form: Form = "mx"
    """Whether the step is an expression of arrays or of single numbers."""
