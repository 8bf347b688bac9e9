"""Joins a kind of layer to its settings, its way to read arguments, and its expansion."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import field
from typing import Any, Generic, TypeAlias, TypeVar

from compiler.ir.program import NodeId
from compiler.layers.rules.layer_context import LayerContext
from spec_schema.fields.entry import Entry
from spec_schema.late_dataclass import dataclass

S = TypeVar("S", bound=Entry)

Arguments: TypeAlias = tuple[NodeId, ...]
Expansion: TypeAlias = Callable[[LayerContext, S, Arguments], NodeId]
Reading: TypeAlias = Callable[[LayerContext, S], NodeId]


@dataclass(frozen=True)
class LayerRule(Generic[S]):
    """One kind of layer. A cell of a local model expands in a context with the cells' axes."""

    settings: type[S]
    """The schema's entry of this kind."""
    read: Callable[[LayerContext, S], Arguments]
    """Counts and lowers the arguments of a call; one of the functions of `arguments.py`."""
    expand: Expansion[S]
    """The value of the layer, out of core operations."""
    members: Mapping[str, Expansion[S]] = field(default_factory=dict[str, "Expansion[S]"])
    """What is called as `NAME.member(expr)`."""
    values: Mapping[str, Reading[S]] = field(default_factory=dict[str, "Reading[S]"])
    """What is read as `NAME.value`, without a call."""
    is_black_box: bool = False
    """Whether its numbers mean nothing one by one: other numbers make the same function, or one
    that no data tell from it."""


AnyRule: TypeAlias = LayerRule[Any]
"""A rule of the registry: its functions take the settings of its own class only."""
