"""The table of conventions where a slope is not defined, in every backend that has derivatives."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from compiler.ir.builder import GraphBuilder
from compiler.ir.ops import Relation
from compiler.ir.program import NodeId
from compiler.ir.types import Axis
from tests.every_op.gradients import Gradient, Problem, by_casadi, by_jacobian, by_torch, problem
from tests.every_op.record import RecordBuilder

MODES: dict[str, Gradient] = {"torch": by_torch, "casadi": by_casadi, "jacobian": by_jacobian}
JOINT = Axis("joint", 2)

Build = Callable[[GraphBuilder, tuple[NodeId, ...]], NodeId]


@dataclass(frozen=True)
class Kink:
    """Operands at which y has this slope in each of them, by decision."""

    build: Build
    at: tuple[float, ...]
    slopes: tuple[float, ...]


def _apply(name: str) -> Build:
    return lambda b, x: b.apply(name, *x)


KINKS = {
    "abs at 0": Kink(_apply("abs"), (0.0,), (0.0,)),
    "sign at 0": Kink(_apply("sign"), (0.0,), (0.0,)),
    "sign of 2": Kink(_apply("sign"), (2.0,), (0.0,)),
    "min of equals": Kink(lambda b, x: b.minimum(*x), (1.5, 1.5), (1.0, 0.0)),
    "max of equals": Kink(lambda b, x: b.maximum(*x), (1.5, 1.5), (1.0, 0.0)),
    "relu at 0": Kink(lambda b, x: b.maximum(b.constant(0.0), x[0]), (0.0,), (0.0,)),
    "clamp on low": Kink(lambda b, x: b.clamp(*x), (-1.0, -1.0, 1.0), (1.0, 0.0, 0.0)),
    "clamp on high": Kink(lambda b, x: b.clamp(*x), (1.0, -1.0, 1.0), (1.0, 0.0, 0.0)),
    "clamp below": Kink(lambda b, x: b.clamp(*x), (-2.0, -1.0, 1.0), (0.0, 1.0, 0.0)),
    "clamp above": Kink(lambda b, x: b.clamp(*x), (2.0, -1.0, 1.0), (0.0, 0.0, 1.0)),
    # min(max(x, low), high): where the limits cross, the upper one is the value, wherever x is
    "clamp above crossed limits": Kink(lambda b, x: b.clamp(*x), (2.0, 1.0, -1.0), (0.0, 0.0, 1.0)),
    "clamp between crossed": Kink(lambda b, x: b.clamp(*x), (0.3, 1.0, -1.0), (0.0, 0.0, 1.0)),
    "clamp below crossed limits": Kink(
        lambda b, x: b.clamp(*x), (-2.0, 1.0, -1.0), (0.0, 0.0, 1.0)
    ),
    "clamp below equal limits": Kink(lambda b, x: b.clamp(*x), (-2.0, 1.0, 1.0), (0.0, 1.0, 0.0)),
    "clamp above equal limits": Kink(lambda b, x: b.clamp(*x), (2.0, 1.0, 1.0), (0.0, 0.0, 1.0)),
    # functions without a kink, where a formula for them could have one
    "softplus at 0": Kink(_apply("softplus"), (0.0,), (0.5,)),
    "sigmoid far left": Kink(_apply("sigmoid"), (-800.0,), (0.0,)),
    "sigmoid far right": Kink(_apply("sigmoid"), (800.0,), (0.0,)),
    "softplus far left": Kink(_apply("softplus"), (-800.0,), (0.0,)),
    "softplus far right": Kink(_apply("softplus"), (800.0,), (1.0,)),
    "tanh far right": Kink(_apply("tanh"), (800.0,), (0.0,)),
}


def _positive(b: GraphBuilder, x: NodeId) -> NodeId:
    return b.compare(Relation.GREATER, x, b.constant(0.0))


def _where_positive(then: Build) -> Build:
    return lambda b, x: b.select(_positive(b, x[0]), then(b, x), b.constant(0.0))


def _otherwise(b: GraphBuilder, x: tuple[NodeId, ...]) -> NodeId:
    condition = b.compare(Relation.LESS_EQUAL, x[0], b.constant(0.0))
    return b.select(condition, b.constant(0.0), b.apply("log", x[0]))


def _nested(b: GraphBuilder, x: tuple[NodeId, ...]) -> NodeId:
    zero = b.constant(0.0)
    inner = b.select(_positive(b, x[1]), b.apply("sqrt", x[0]), x[0])
    return b.select(_positive(b, x[0]), inner, zero)


def _wide(b: GraphBuilder, x: tuple[NodeId, ...]) -> NodeId:
    row = b.constant((1.0, 2.0), (JOINT,))
    return b.sum(b.select(_positive(b, x[0]), b.divide(row, x[0]), row), "joint")


def _summed(b: GraphBuilder, x: tuple[NodeId, ...]) -> NodeId:
    row = b.constant((1.0, 2.0), (JOINT,))
    return b.select(_positive(b, x[0]), b.sum(b.divide(row, x[0]), "joint"), x[0])


def _root_of_crossed_limits(b: GraphBuilder, x: tuple[NodeId, ...]) -> NodeId:
    """√min(max(x, 1), y²), which is |y| for y below 1: at 0 an infinite slope times 2·y."""
    return b.apply("sqrt", b.clamp(x[0], b.constant(1.0), b.multiply(x[1], x[1])))


UNTAKEN = {
    "root of crossed limits": Kink(_root_of_crossed_limits, (0.5, 0.0), (0.0, 0.0)),
    "sqrt of a negative": Kink(
        _where_positive(lambda b, x: b.apply("sqrt", x[0])), (-1.0,), (0.0,)
    ),
    "sqrt at 0": Kink(_where_positive(lambda b, x: b.apply("sqrt", x[0])), (0.0,), (0.0,)),
    "division by 0": Kink(
        _where_positive(lambda b, x: b.divide(x[1], x[0])), (0.0, 3.0), (0.0, 0.0)
    ),
    "product with log 0": Kink(
        _where_positive(lambda b, x: b.multiply(x[1], b.apply("log", x[0]))), (0.0, 3.0), (0.0, 0.0)
    ),
    "power of 0": Kink(_where_positive(lambda b, x: b.apply("pow", *x)), (0.0, 0.5), (0.0, 0.0)),
    "else branch": Kink(_otherwise, (-1.0,), (0.0,)),
    "nested": Kink(_nested, (-1.0, 1.0), (0.0, 0.0)),
    "condition broadcast": Kink(_wide, (0.0,), (0.0,)),
    "condition on a sum": Kink(_summed, (0.0,), (1.0,)),
    "taken": Kink(_where_positive(lambda b, x: b.apply("sqrt", x[0])), (4.0,), (0.25,)),
}


def _at(kink: Kink) -> Problem:
    r = RecordBuilder()
    operands = [r.sample(f"x{i}", np.full(8, value)) for i, value in enumerate(kink.at)]
    r.expect("y", kink.build(r.graph, tuple(operands)), np.zeros(8))
    record = r.record("kink")
    p = problem(record.program, record.log, record.times[:1])
    return Problem(p.program, p.interface, p.variables, {("output", "y"): np.ones(())})


@pytest.mark.parametrize("name", [*KINKS, *UNTAKEN])
@pytest.mark.parametrize("mode", MODES)
def test_slope_is_as_decided(name: str, mode: str):
    kink = {**KINKS, **UNTAKEN}[name]
    slopes = MODES[mode](_at(kink))
    for i, expected in enumerate(kink.slopes):
        assert slopes["port", f"x{i}"] == pytest.approx([expected], abs=1e-15), f"in x{i}"
