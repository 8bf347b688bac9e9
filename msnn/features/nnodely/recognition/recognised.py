"""Describes a recognised group of relations and its dependencies."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from msnn.features.nnodely.functions import Functions
from msnn.features.nnodely.layers.layers import Layers
from msnn.features.nnodely.signals import Signals
from msnn.features.nnodely.terms.values import Value, ValueOperations


class Followed(Protocol):
    """The relations around a recognised form, as it reads them."""

    values: ValueOperations
    layers: Layers
    functions: Functions
    signals: Signals | None

    def operand(self, name: str) -> Value: ...


@dataclass(frozen=True, slots=True)
class Recognised:
    """The required relations, and the construction of the value from theirs."""

    needs: tuple[str, ...]
    make: Callable[[Followed], Value]
