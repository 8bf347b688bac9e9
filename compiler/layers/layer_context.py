"""What a layer may do while it expands: build nodes and declare the arrays it learns."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from compiler.builder import GraphBuilder
from compiler.program import NodeId
from compiler.scalar_functions import Array
from compiler.types import Axis, Type
from spec_schema.source import Span
from spec_schema.units import Unit


class ParameterTable(Protocol):
    """Where a layer's learnable arrays are declared; the first call decides their shapes."""

    def declare(
        self,
        name: str,
        axes: tuple[Axis, ...],
        initial: Array,
        unit: Unit | None,
        doc: str,
        span: Span,
    ) -> Type: ...


@dataclass(frozen=True)
class LayerContext:
    """One call of a layer."""

    name: str
    """Name of the layer in the spec; its arrays are called `name.weight` and so on."""
    builder: GraphBuilder
    parameters: ParameterTable
    span: Span
    """Place of the layer's declaration."""
    dimension: Callable[[str, Span], Axis]
    """The axis of a name of `dims:`; reports an unknown one and raises LoweringFailed."""
    cells: tuple[Axis, ...] = ()
    """Axes of a local model's activations: every cell has weights of its own."""

    def in_cells(self, cells: tuple[Axis, ...]) -> LayerContext:
        """The context of a cell of a local model."""
        return replace(self, cells=cells)

    def learned(
        self,
        suffix: str,
        axes: tuple[Axis, ...],
        initial: Array,
        doc: str,
        unit: Unit | None = None,
    ) -> NodeId:
        """A learnable array of the layer, one for each cell; `initial` has the shape of `axes`."""
        full = (*self.cells, *axes)
        shape = tuple(axis.size for axis in full)
        values = np.broadcast_to(np.asarray(initial, dtype=float), shape)
        type = self.parameters.declare(f"{self.name}.{suffix}", full, values, unit, doc, self.span)
        return self.builder.parameter(f"{self.name}.{suffix}", type)

    def small_random(self, suffix: str, axes: tuple[Axis, ...], bound: float) -> Array:
        """Uniform numbers in ±bound, different for every array and the same on every machine.

        The generator is counter-based (Philox; Salmon et al. 2011), keyed by the array's name.
        """
        digest = hashlib.sha256(f"{self.name}.{suffix}".encode()).digest()
        generator = np.random.Generator(np.random.Philox(key=int.from_bytes(digest[:8], "little")))
        shape = tuple(axis.size for axis in (*self.cells, *axes))
        return generator.uniform(-bound, bound, shape)
