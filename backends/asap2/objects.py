"""Describes numbers, arrays and tables in the memory of generated C for ASAP2 files."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

import numpy as np

from compiler.ir import ops
from compiler.ir.program import Graph, Node, NodeId, Parameter, Program
from compiler.ir.types import UNNAMED, Type

Struct: TypeAlias = Literal["params", "in", "out", "state", "calibration"]
"""A struct of the header, by the middle part of its type name."""

Storage: TypeAlias = Literal["FLOAT32_IEEE", "FLOAT64_IEEE", "SWORD", "SLONG", "A_INT64", "ULONG"]
"""The ASAP2 name of the data type of an element."""


@dataclass(frozen=True, slots=True)
class Scale:
    """The scaling of stored values: physical = factor · stored. If `factor` is None, stored values
    are physical.
    """

    unit: str
    """Empty if the spec has no unit."""
    factor: float | None = None


@dataclass(frozen=True, slots=True)
class Knots:
    """The points along one axis of a curve or a map (lookup table), which are constants in the
    code. `unit` is that of the points, empty if unknown.
    """

    values: tuple[float, ...]
    unit: str
    of: str | None
    """The input or state that is looked up, by its name in the spec; None for a computed value."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MemoryObject:
    """A member of a C struct that a calibration tool can read or set: a parameter or a measurement.
    `doc` is its documentation in the spec.
    """

    name: str
    """The name in the spec."""
    member: str
    struct: Struct
    doc: str
    axes: tuple[tuple[str, int], ...]
    """Names and lengths of the axes, in C order."""
    scale: Scale
    low: float
    high: float
    """Physical limit; infinite if only the data type limits it."""
    storage: Storage
    knots: tuple[Knots, ...] = ()
    """For a curve or a map, the points of each axis longer than 1; otherwise empty."""

    @property
    def shape(self) -> tuple[int, ...]:
        return tuple(size for _, size in self.axes)

    @property
    def size(self) -> int:
        return math.prod(self.shape)


@dataclass(frozen=True, slots=True)
class Segment:
    """A memory range of its own for one C variable; `size` is in bytes."""

    type: str
    """The C type of the variable."""
    section: str
    """The linker section."""
    size: int


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibratedModel:
    """The content of an ASAP2 file (A2L) for the C code of one model.

    It describes the parameters, inputs, outputs and states that a calibration tool reads or sets.
    """

    name: str
    prefix: str
    """Prefix of the C type names and of all names in the file."""
    doc: str
    version: str
    """The version of the spec from which it was generated."""
    objects: Sequence[MemoryObject] = field(default=())
    segment: Segment | None = None
    """The memory segment of the parameters, if they have their own."""
    remark: str = ""
    """A remark for the head of the file."""


def grids(program: Program) -> dict[str, Knots]:
    """The points of each axis of lookup tables in the step, by name of axis.

    A lookup is found by its operation: the step subtracts an ascending list of constants from a
    value, or compares the value with the list. The list has one axis, which the value lacks. An
    axis is omitted if two different lists have its name, or if one list serves values of different
    inputs, states or units.
    """
    graph = program.step
    found: dict[str, set[Knots]] = {}
    for _, node in graph:
        if not isinstance(node.op, ops.Subtract | ops.Compare):
            continue
        # fuzzy sets and tables take the distance from points, or compare with them
        value, points = (graph.unrepeated(arg) for arg in node.args)
        at, kind = graph[points].op, graph[points].type
        if not isinstance(at, ops.Constant) or len(kind.axes) != 1:
            continue
        axis = kind.axes[0]
        # a value along the axis itself is no number that is looked up on it
        if graph[value].type.axis(axis.name) is not None or not _ascends(at.values):
            continue
        unit = graph[value].type.unit
        knots = Knots(at.values, "" if unit is None else unit.text, _looked_up(graph, value))
        for name in _names_downstream(graph, points, axis.name):
            found.setdefault(name, set()).add(knots)
    # two lists of numbers along one axis: neither is told
    return {name: next(iter(all)) for name, all in found.items() if len(all) == 1}


def knots_of(parameter: Parameter, grids: dict[str, Knots]) -> tuple[Knots, ...]:
    """For a curve or a map, a parameter with one or two axes longer than 1: the points of each of
    these axes from `grids`. Empty for other parameters, and unless all axes have points in the
    right number.
    """
    # an axis of one element, as that of a layer's only argument, moves nothing in memory
    axes = [axis for axis in parameter.axes if axis.size > 1]
    if not 1 <= len(axes) <= 2 or any(axis.name not in grids for axis in axes):
        return ()
    found = tuple(grids[axis.name] for axis in axes)
    # one name may have two sizes, where layers cut an axis
    fits = all(len(knots.values) == axis.size for knots, axis in zip(found, axes, strict=True))
    return found if fits else ()


def _ascends(values: tuple[float, ...]) -> bool:
    return len(values) > 1 and bool(np.all(np.diff(values) > 0)) and bool(np.isfinite(values).all())


def _looked_up(graph: Graph, node: NodeId) -> str | None:
    """The name of the scalar input or state that a node copies, through broadcasts and reshapes;
    None if the node computes something else.
    """
    while isinstance(graph[node].op, ops.Broadcast | ops.Reshape | ops.Identity):
        (node,) = graph[node].args
    if graph[node].type.size != 1:
        return None
    match graph[node].op:
        case ops.ReadSignal(name) | ops.ReadState(name):
            return name
        case _:
            return None


def _names_downstream(graph: Graph, first: NodeId, name: str) -> set[str]:
    """The names that the axis `name` of the node `first` has in this node and in all nodes computed
    from it along the axis. Axes without a name are left out.
    """
    along: dict[NodeId, str] = {first: name}
    for index, node in graph:
        if index in along:
            continue
        for arg in node.args:
            if arg in along and (new := _renamed(along[arg], graph[arg].type, node)) is not None:
                along[index] = new
                break
    return set(along.values()) - {UNNAMED}


def _renamed(name: str, before: Type, node: Node) -> str | None:
    """The name that the axis `name` of an operand of type `before` has in the result of the node;
    None if the result lacks the axis.
    """
    if isinstance(node.op, ops.Reshape):
        if before.shape != node.type.shape:
            return None
        return node.type.axes[before.position(name)].name
    kept = node.type.axis(name)
    return name if kept is not None and kept == before.axis(name) else None
