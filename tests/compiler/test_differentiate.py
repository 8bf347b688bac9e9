"""The differentiate pass against central differences, and its conventions at kinks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from compiler.differentiation.reverse_mode import step_gradients
from compiler.interpreter.interpreter import Interpreter
from compiler.ir.builder import GraphBuilder
from compiler.ir.ops import Relation
from compiler.ir.program import Graph, NodeId, Output, Program, Role, Signal
from compiler.ir.types import Type
from compiler.passes.guard_derivatives import guard_untaken
from tests.every_op.gradients import Problem, Variables, by_differences, problem
from tests.every_op.record import Record
from tests.every_op.records import RECORDS


def by_program(p: Problem) -> Variables:
    """Slopes that the pass makes part of the program, evaluated by the interpreter."""
    builder = GraphBuilder(p.program.step)
    adjoints: dict[NodeId, NodeId] = {}
    results = {("output", o.name): o.node for o in p.program.outputs}
    results |= {("next", s.name): s.next for s in p.program.states}
    for key, node in results.items():
        weight = builder.constant(p.weights[key], builder.type(node).axes)
        adjoints[node] = builder.add(adjoints[node], weight) if node in adjoints else weight
    found = step_gradients(builder, adjoints)
    named = (("state", found.states), ("parameter", found.parameters), ("port", found.signals))
    outputs = tuple(
        Output(f"{kind} {name}", node) for kind, nodes in named for name, node in nodes.items()
    )
    program = replace(p.program, step=builder.graph(), outputs=outputs)
    log, t = log_of(p)
    states = {name: value for (kind, name), value in p.variables.items() if kind == "state"}
    step = Interpreter(program).step(log, t, states)
    slopes: Variables = {}
    for (kind, name), value in p.variables.items():
        slope = step.outputs.get(f"{kind} {name}")
        if slope is None:
            slopes[kind, name] = np.zeros_like(value)
        elif kind == "parameter":
            slopes[kind, name] = np.sum(np.broadcast_to(slope, (p.members, *value.shape)), axis=0)
        else:
            slopes[kind, name] = np.broadcast_to(slope, value.shape)
    return slopes


def log_of(p: Problem) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """A log in which row stride·i + offset is member i's t, so that each finds its own windows."""
    ports = {port.signal.name: port for port in p.interface.inputs}
    before = max((-port.first for port in ports.values()), default=0)
    after = max((port.last for port in ports.values()), default=0)
    stride = max(before, 0) + max(after, 0) + 1
    t = np.arange(p.members) * stride + max(before, 0)
    log: dict[str, np.ndarray] = {}
    for name, port in ports.items():
        value = p.variables["port", name]
        samples = value if port.type.window else value[..., None]
        series = np.zeros((p.members * stride, *samples.shape[1:-1]))
        for place in range(samples.shape[-1]):
            series[t + port.first + place] = samples[..., place]
        log[name] = series
    return log, t


@pytest.mark.parametrize("record", RECORDS, ids=lambda record: record.name)
def test_gradient_matches_central_differences(record: Record) -> None:
    p = problem(record.program, record.log, record.smooth_times)
    expected, found = by_differences(p), by_program(p)
    assert found.keys() == expected.keys()
    for key, slope in expected.items():
        # differences of step 1e-6 relative lose half of the digits
        scale = max(1.0, float(np.max(np.abs(slope), initial=0.0)))
        np.testing.assert_allclose(
            found[key], slope, atol=2e-7 * scale, rtol=2e-6, err_msg=str(key)
        )


def slope_at(make: str, x: float) -> float:
    """∂y/∂x of one of the functions below."""
    b = GraphBuilder()
    node = b.signal("x", 0, 0, Type())
    zero = b.constant(0.0)
    value = {
        "abs": lambda: b.apply("abs", node),
        "sign": lambda: b.apply("sign", node),
        "relu": lambda: b.maximum(zero, node),
        "min first": lambda: b.minimum(node, zero),
        "min second": lambda: b.minimum(zero, node),
        "clamp": lambda: b.clamp(node, b.constant(-1.0), b.constant(1.0)),
        "guarded sqrt": lambda: b.select(
            b.compare(Relation.GREATER, node, zero), b.apply("sqrt", node), zero
        ),
        "guarded log": lambda: b.select(
            b.compare(Relation.LESS_EQUAL, node, zero), zero, b.apply("log", node)
        ),
        "guarded quotient": lambda: b.select(
            b.compare(Relation.GREATER, node, zero), b.divide(b.constant(1.0), node), zero
        ),
    }[make]()
    signal = Signal("x", Role.INPUT)
    program = guard_untaken(
        Program("kink", None, (signal,), (), (), b.graph(), Graph(), (Output("y", value),))
    )
    builder = GraphBuilder(program.step)
    adjoints = {program.outputs[0].node: builder.constant(1.0)}
    slope = step_gradients(builder, adjoints).signals["x"]
    program = replace(program, step=builder.graph(), outputs=(Output("slope", slope),))
    step = Interpreter(program).step({"x": np.array([x])}, np.array([0]), {})
    return float(step.outputs["slope"][0])


@pytest.mark.parametrize(
    ("function", "x", "slope"),
    [
        ("abs", 0.0, 0.0),
        ("abs", -2.0, -1.0),
        ("sign", 0.0, 0.0),
        ("relu", 0.0, 0.0),
        ("relu", 1.0, 1.0),
        ("min first", 0.0, 1.0),
        ("min second", 0.0, 0.0),
        ("clamp", 1.0, 1.0),
        ("clamp", -1.0, 1.0),
        ("clamp", 1.5, 0.0),
        ("guarded sqrt", 0.0, 0.0),
        ("guarded sqrt", 4.0, 0.25),
        ("guarded log", 0.0, 0.0),
        ("guarded log", 2.0, 0.5),
        ("guarded quotient", 0.0, 0.0),
        ("guarded quotient", 2.0, -0.25),
    ],
)
def test_slopes_at_kinks(function: str, x: float, slope: float) -> None:
    assert slope_at(function, x) == slope
