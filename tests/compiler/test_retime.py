"""Retiming keeps what a program computes, and leaves alone what it must not move."""

from __future__ import annotations

import numpy as np
import pytest

from compiler.interpreter.interpreter import Interpreter
from compiler.ir.builder import GraphBuilder
from compiler.ir.program import Graph, Output, Parameter, Program, Role, Signal
from compiler.ir.types import WINDOW, Axis, Type
from compiler.ir.verifier import verify
from compiler.passes.close_loop import close_loop
from compiler.passes.retime import retime
from compiler.passes.to_step_form import to_step_form
from tests.pass_programs import mapped_windows
from tests.programs import SAMPLES


def _outputs(program: Program, gains: tuple[float, ...] = ()) -> np.ndarray:
    """Outputs of steps from a past that is not zero; `k` changes from step to step."""
    random = np.random.default_rng(3)
    log = {signal.name: random.uniform(0.5, 2.0, 40) for signal in program.signals}
    states = Interpreter(program).start(log, 10)
    rows: list[np.ndarray] = []
    for k in range(20):
        weights = {"k": np.array(gains[k % len(gains)])} if gains else {}
        result = Interpreter(program, weights).step(log, 10 + k, states)
        states = result.next_states
        rows.append(np.array([value[0] for value in result.outputs.values()]))
    return np.array(rows)


def test_outputs_stay_from_the_first_step_on() -> None:
    program = mapped_windows()
    moved = retime(program, fixed_parameters=True)
    verify(moved)
    assert np.array_equal(_outputs(program), _outputs(moved))


def test_a_parameter_that_changes_keeps_its_window() -> None:
    program = mapped_windows()
    fixed, free = (retime(program, fixed_parameters=choice) for choice in (True, False))
    gains = (0.2, 0.9, -0.4)
    assert np.array_equal(_outputs(program, gains), _outputs(free, gains))
    assert not np.allclose(_outputs(program, gains), _outputs(fixed, gains))


def test_calls_are_made_once_a_step() -> None:
    moved = retime(mapped_windows(), fixed_parameters=True)
    names = {state.name: state.axes for state in moved.states}
    assert set(names) == {
        "angle.history",
        "angle.mapped.history",
        "angle.mapped.history2",
        "offset_free.history",
    }
    assert "level.history" not in names


@pytest.mark.parametrize("name", SAMPLES)
def test_samples_compute_the_same(name: str) -> None:
    sample = SAMPLES[name]()
    program = to_step_form(close_loop(sample.program, sample.closed))
    moved = retime(program, fixed_parameters=True)
    verify(moved)
    log, starts = sample.log(60, 5), np.array([8, 20])
    before, after = (Interpreter(p).rollout(log, starts, 20) for p in (program, moved))
    for output, values in before.outputs.items():
        assert np.array_equal(values, after.outputs[output]), output


def test_weights_along_the_window_are_no_function_of_samples() -> None:
    b = GraphBuilder()
    window = b.signal("x", -2, 0, Type((Axis(WINDOW, 3),)))
    weighted = b.multiply(window, b.parameter("w", Type((Axis(WINDOW, 3),))))
    outputs = (Output("y", b.sum(b.apply("tanh", weighted), WINDOW)),)
    parameters = (Parameter("w", (Axis(WINDOW, 3),), initial=(1.0, 2.0, 3.0)),)
    signals = (Signal("x", Role.INPUT),)
    program = to_step_form(
        Program("weighted", 0.1, signals, parameters, (), b.graph(), Graph(), outputs)
    )
    assert retime(program, fixed_parameters=True) == program


def test_long_functions_need_no_deep_stack() -> None:
    b = GraphBuilder()
    value = b.signal("x", -2, 0, Type((Axis(WINDOW, 3),)))
    for _ in range(5_000):
        value = b.add(value, b.constant(1.0))
    outputs = (Output("y", b.sum(value, WINDOW)),)
    signals = (Signal("x", Role.INPUT),)
    program = Program("chain", 0.1, signals, (), (), b.graph(), Graph(), outputs)
    moved = retime(to_step_form(program), fixed_parameters=True)
    assert [state.axes[-1].size for state in moved.states] == [2]
    assert Interpreter(moved).step({"x": np.zeros(3)}, 2, {**_zero(moved)}).outputs["y"][0] > 0


def _zero(program: Program) -> dict[str, np.ndarray]:
    return {s.name: np.zeros((1, *(a.size for a in s.axes))) for s in program.states}
