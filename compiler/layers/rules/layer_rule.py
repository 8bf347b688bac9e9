"""Defines the rule of a kind of layer: its settings, arguments and expansion."""

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
    """The rule of one kind of layer.

    In a local model it expands in a context with the cells' axes.
    """

    settings: type[S]
    """The class of its settings in the schema."""
    read: Callable[[LayerContext, S], Arguments]
    """Checks and lowers the arguments of a call; one of the functions of `arguments.py`."""
    expand: Expansion[S]
    """Builds the value of the layer from core operations."""
    members: Mapping[str, Expansion[S]] = field(default_factory=dict[str, "Expansion[S]"])
    """Expansions of calls `NAME.member(expr)`."""
    values: Mapping[str, Reading[S]] = field(default_factory=dict[str, "Reading[S]"])
    """Values that are read as `NAME.value`, without a call."""
    is_black_box: bool = False
    """True if single parameters have no meaning, as in a neural network: other parameters give
    the same function, or one that no data distinguish from it."""


AnyRule: TypeAlias = LayerRule[Any]
"""A rule of the registry; its functions accept only settings of its own class."""
