"""Records of the elementwise operations, each in all layouts of axes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from compiler.ir.builder import GraphBuilder
from compiler.ir.ops import Relation
from compiler.ir.program import NodeId
from compiler.ir.types import UNNAMED, Axis
from tests.every_op.record import WINDOW_LENGTH, Array, Record, RecordBuilder, windows_of
from tests.every_op.samples import JOINT, PAIRS, WHEEL, operand, smooth, with_special

Emit = Callable[..., NodeId]
Meaning = Callable[..., Array]

LAYOUTS: dict[str, tuple[Axis, ...]] = {
    "scalar": (),
    "named": (JOINT,),
    "two": (JOINT, WHEEL),
}
"""Axes of one sample; windows of the first two and an unnamed axis come on top."""


def elementwise(
    name: str, emit: Callable[[GraphBuilder], Emit], meaning: Meaning, *series: Callable[..., Array]
) -> Record:
    """A record with one output a layout; `series` make the operands' samples for a shape."""
    r = RecordBuilder()
    operate = emit(r.graph)
    for layout, axes in LAYOUTS.items():
        shape = tuple(axis.size for axis in axes)
        samples = [make(*shape) for make in series]
        nodes = [r.sample(f"{layout}_{i}", s, axes) for i, s in enumerate(samples)]
        values = [r.logged(f"{layout}_{i}") for i in range(len(samples))]
        r.expect(f"y_{layout}", operate(*nodes), meaning(*values))
        if layout == "named":
            unnamed = (Axis(UNNAMED, JOINT.size),)
            nodes = [r.graph.reshape(node, unnamed) for node in nodes]
            r.expect("y_unnamed", operate(*nodes), meaning(*values))
        if layout != "two":
            past = [r.past(f"{layout}_{i}") for i in range(len(samples))]
            windows = [windows_of(value, 1 - WINDOW_LENGTH, 0) for value in values]
            r.expect(f"y_{layout}_window", operate(*past), meaning(*windows))
    return r.record(name)


def _first(*shape: int) -> Array:
    return operand(0, *shape)


def _second(*shape: int) -> Array:
    return operand(1, *shape)


def _bound(side: int) -> Callable[..., Array]:
    """Bounds around the smooth samples' middle, then the other operand of PAIRS, or ∓1."""

    def bound(*shape: int) -> Array:
        samples = side * (0.25 * np.abs(smooth(5 + side, *shape, shift=0.25)) + 0.4)
        special = PAIRS[:, 1] if side < 0 else np.where(np.isnan(PAIRS[:, 1]), 1.0, 2.5)
        return with_special(samples, special)

    return bound


def _compared(relation: Relation) -> Callable[[GraphBuilder], Emit]:
    """Bools are no outputs; 1 and 0 stand for them."""

    def emit(b: GraphBuilder) -> Emit:
        one, zero = b.constant(1.0), b.constant(0.0)
        return lambda left, right: b.select(b.compare(relation, left, right), one, zero)

    return emit


def _selected(b: GraphBuilder) -> Emit:
    return lambda left, right: b.select(b.compare(Relation.LESS, left, right), left, right)


def _one(relation: Callable[[Array, Array], Array]) -> Meaning:
    return lambda left, right: relation(left, right).astype(float)


def elementwise_records() -> dict[str, Record]:
    """Records by the name of the operation."""
    pair = (_first, _second)
    rows: dict[
        str, tuple[Callable[[GraphBuilder], Emit], Meaning, tuple[Callable[..., Array], ...]]
    ]
    rows = {
        "Add": (lambda b: b.add, np.add, pair),
        "Subtract": (lambda b: b.subtract, np.subtract, pair),
        "Multiply": (lambda b: b.multiply, np.multiply, pair),
        "Divide": (lambda b: b.divide, np.divide, pair),
        "Negate": (lambda b: b.negate, np.negative, pair[:1]),
        "Dropout": (lambda b: lambda x: b.dropout(x, 0.5, "h"), lambda x: x, pair[:1]),
        "Named": (lambda b: lambda x: b.named(x, "e"), lambda x: x, pair[:1]),
        "Minimum": (lambda b: b.minimum, np.minimum, pair),
        "Maximum": (lambda b: b.maximum, np.maximum, pair),
        "Clamp": (
            lambda b: b.clamp,
            lambda x, low, high: np.minimum(np.maximum(x, low), high),
            (_first, _bound(-1), _bound(1)),
        ),
        "Compare<": (_compared(Relation.LESS), _one(np.less), pair),
        "Compare<=": (_compared(Relation.LESS_EQUAL), _one(np.less_equal), pair),
        "Compare>": (_compared(Relation.GREATER), _one(np.greater), pair),
        "Compare>=": (_compared(Relation.GREATER_EQUAL), _one(np.greater_equal), pair),
        "Select": (_selected, lambda a, b: np.where(a < b, a, b), pair),
    }
    with np.errstate(all="ignore"):
        return {name: elementwise(name, *row[:2], *row[2]) for name, row in rows.items()}
