"""The tangents pass: J·v against vᵀ·(reverse mode) and central differences for every operation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from compiler.differentiation.forward_mode import tangents
from compiler.interpreter.interpreter import Interpreter
from compiler.ir.builder import GraphBuilder
from compiler.ir.ops import ReadParameter, ReadSignal, ReadState, Relation, Window
from compiler.ir.program import Declared, NodeId, Output, Program, Role, Signal, State
from compiler.ir.types import Axis, Type
from compiler.passes.guard_derivatives import guard_untaken
from tests.compiler.test_differentiate import by_program, log_of
from tests.every_op.gradients import Problem, Variables, by_differences, problem
from tests.every_op.record import Record
from tests.every_op.records import RECORDS

DIRECTIONS = Axis("direction", 3)
SLOPE = "slope of "


def _directions(p: Problem) -> Variables:
    """A change of every variable in each direction, the same for all members."""
    random = np.random.default_rng(11)
    return {
        (kind, name): random.normal(
            size=(DIRECTIONS.size, *(value.shape if kind == "parameter" else value.shape[1:]))
        )
        for (kind, name), value in p.variables.items()
    }


def _forward(p: Problem, directions: Variables) -> np.ndarray:
    """Σ weight · tangent over all results and members, a number a direction."""
    builder = GraphBuilder(p.program.step)
    seeds: dict[NodeId, NodeId] = {}
    buffers: dict[str, str] = {}
    slopes: list[State] = []
    zero = builder.constant(0.0)
    for index, node in builder.graph():
        match node.op:
            case ReadParameter(name):
                key = ("parameter", name)
            case ReadSignal(name):
                key = ("port", name)
            case ReadState(name):
                key = ("state", name)
            case Window(name):
                buffers[name] = f"{SLOPE}{name}"
                state = p.program.state(name)
                axes = (DIRECTIONS, *state.axes)
                slopes.append(State(buffers[name], axes, None, Declared(), zero, zero))
                continue
            case _:
                continue
        seeds[index] = builder.constant(directions[key], (DIRECTIONS, *node.type.axes), unit=None)
    found = tangents(builder, DIRECTIONS, seeds, buffers)
    results = {("output", o.name): o.node for o in p.program.outputs}
    results |= {("next", s.name): s.next for s in p.program.states}
    outputs = tuple(
        Output(str(number), found[node])
        for number, node in enumerate(results.values())
        if node in found
    )
    keys = [key for key, node in results.items() if node in found]
    # the states that only windows read are given by the test, not simulated
    program = replace(p.program, step=builder.graph(), outputs=outputs, states=())
    log, t = log_of(p)
    states = {name: value for (kind, name), value in p.variables.items() if kind == "state"}
    for state in slopes:
        seed = directions["state", state.name.removeprefix(SLOPE)]
        states[state.name] = np.broadcast_to(seed, (p.members, *seed.shape))
    step = Interpreter(program).step(log, t, states)
    total = np.zeros(DIRECTIONS.size)
    for output, key in zip(outputs, keys, strict=True):
        value = step.outputs[output.name] * p.weights[key]
        total += value.reshape(p.members, DIRECTIONS.size, -1).sum(axis=(0, 2))
    return total


def _along(slopes: Variables, directions: Variables) -> np.ndarray:
    total = np.zeros(DIRECTIONS.size)
    for (kind, name), slope in slopes.items():
        whole = slope if kind == "parameter" else slope.sum(axis=0)
        seed = directions[kind, name]
        total += (seed * whole).reshape(DIRECTIONS.size, -1).sum(axis=1)
    return total


@pytest.mark.parametrize("record", RECORDS, ids=lambda record: record.name)
def test_tangents_are_the_transpose_of_reverse_mode(record: Record) -> None:
    p = problem(guard_untaken(record.program), record.log, record.smooth_times)
    directions = _directions(p)
    found, expected = _forward(p, directions), _along(by_program(p), directions)
    # the same products in another order
    scale = max(1.0, float(np.abs(expected).max(initial=0.0)))
    np.testing.assert_allclose(found, expected, atol=1e-10 * scale, rtol=1e-10)


@pytest.mark.parametrize("record", RECORDS, ids=lambda record: record.name)
def test_tangents_are_central_differences(record: Record) -> None:
    p = problem(record.program, record.log, record.smooth_times)
    directions = _directions(p)
    found, expected = _forward(p, directions), _along(by_differences(p), directions)
    # differences of step 1e-6 relative lose half of the digits
    scale = max(1.0, float(np.abs(expected).max(initial=0.0)))
    np.testing.assert_allclose(found, expected, atol=1e-6 * scale, rtol=1e-6)


def test_a_branch_that_is_not_taken_adds_nothing() -> None:
    """The slope of √x at 0 is infinite, the tangents of where(x > 0, √x, 0) are not."""
    builder = GraphBuilder()
    x = builder.signal("x", 0, 0, Type())
    zero = builder.constant(0.0)
    root = builder.select(
        builder.compare(Relation.GREATER, x, zero), builder.apply("sqrt", x), zero
    )
    seed = builder.constant([1.0, 2.0], (Axis("direction", 2),))
    tangent = tangents(builder, Axis("direction", 2), {x: seed}, {})[root]
    program = Program(
        name="root",
        sample_time=None,
        signals=(Signal("x", Role.INPUT, (), None),),
        parameters=(),
        states=(),
        step=builder.graph(),
        start=GraphBuilder().graph(),
        outputs=(Output("slope", tangent),),
    )
    values = Interpreter(program).step({"x": np.array([0.0, 4.0])}, [0, 1], {})
    assert values.outputs["slope"].tolist() == [[0.0, 0.0], [0.25, 0.5]]


@pytest.mark.parametrize(
    ("at", "expected"),
    [
        ((0.3, -1.0, 1.0), [1.0, 0.0, 0.0]),
        ((-2.0, -1.0, 1.0), [0.0, 1.0, 0.0]),
        ((2.0, -1.0, 1.0), [0.0, 0.0, 1.0]),
        # limits that cross: the value is the upper one
        ((-2.0, 1.0, -1.0), [0.0, 0.0, 1.0]),
        ((0.3, 1.0, -1.0), [0.0, 0.0, 1.0]),
        ((2.0, 1.0, -1.0), [0.0, 0.0, 1.0]),
    ],
)
def test_a_clamp_moves_with_what_it_takes(
    at: tuple[float, float, float], expected: list[float]
) -> None:
    names = ("x", "low", "high")
    builder = GraphBuilder()
    operands = [builder.signal(name, 0, 0, Type()) for name in names]
    directions = Axis("direction", 3)
    rows = np.eye(3).tolist()
    seeds = {
        node: builder.constant(row, (directions,)) for node, row in zip(operands, rows, strict=True)
    }
    clamped = builder.clamp(*operands)
    tangent = tangents(builder, directions, seeds, {})[clamped]
    program = Program(
        name="clamp",
        sample_time=None,
        signals=tuple(Signal(name, Role.INPUT, (), None) for name in names),
        parameters=(),
        states=(),
        step=builder.graph(),
        start=GraphBuilder().graph(),
        outputs=(Output("slope", tangent),),
    )
    log = {name: np.array([value]) for name, value in zip(names, at, strict=True)}
    values = Interpreter(program).step(log, [0], {})
    assert values.outputs["slope"].tolist() == [expected]
