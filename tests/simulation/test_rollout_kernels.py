"""Kernels of rollouts against the interpreter: outputs of every step, sums of losses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from backends.native import rollout_kernel
from compiler.passes.close_loop import close_loop
from msnn.data.dataset import BoolArray, FloatArray
from msnn.data.rollout_rows import Runs
from msnn.simulation.engines.engine import interpreted_rollouts
from msnn.simulation.engines.native_rollouts import NativeRollouts
from tests.conditions import require_tool
from tests.language.compiled import compiled
from tests.native.test_kernel import MODELS, initial, log_of

ONE_STEP = 1e-12
FREE_RUN = 1e-9
"""Of the largest value: what engines may differ in, where the dynamics contract."""

LENGTHS = (3, 60, 1, 17, 60, 2, 40, 9, 33, 60, 5)
"""Of rollouts side by side: more than one group of lanes, and the lanes of each end apart."""


@pytest.fixture(autouse=True)
def _compiler() -> None:
    require_tool("gcc", install="apt install gcc")


def nobody(steps: int) -> None:
    del steps


def runs_of(starts: list[int], steps: list[int]) -> Runs:
    return Runs(np.array(starts), np.array(steps), 0, 0)


def assert_near(found: FloatArray, right: FloatArray, tolerance: float) -> None:
    np.testing.assert_allclose(
        found, right, rtol=tolerance, atol=tolerance * float(np.abs(right).max())
    )


@pytest.mark.parametrize("name", MODELS)
def test_outputs_are_those_of_the_interpreter(name: str) -> None:
    text, closed = MODELS[name]
    program = close_loop(compiled(text), closed)
    log, weights = log_of(program), initial(program)
    native = NativeRollouts(program, weights, log)
    judge = interpreted_rollouts(program, weights, log)
    runs = runs_of([10 + 2 * i for i in range(len(LENGTHS))], list(LENGTHS))
    native.check(runs)
    found, right = native.outputs(runs, nobody), judge.outputs(runs, nobody)
    steps = runs_of(list(range(10, 80)), [1] * 70)
    one, first = native.outputs(steps, nobody), judge.outputs(steps, nobody)
    for output in program.outputs:
        assert_near(one[output.name], first[output.name], ONE_STEP)
        assert_near(found[output.name], right[output.name], FREE_RUN)


@pytest.mark.parametrize("name", MODELS)
def test_losses_are_those_of_the_interpreter(name: str) -> None:
    """With missing targets, from step 2 on, on the rows that count and on all."""
    text, closed = MODELS[name]
    program = close_loop(compiled(text), closed)
    log, weights = log_of(program), initial(program)
    read = {signal.name for signal in program.signals if signal.role.name == "TARGET"}
    for target in read - set(closed):
        log[target][1::6] = np.nan  # no run starts there
    counted: dict[str, BoolArray] = {
        loss.name: np.arange(90) % 3 != i % 3 for i, loss in enumerate(program.losses)
    }
    native = NativeRollouts(program, weights, log)
    judge = interpreted_rollouts(program, weights, log)
    runs = runs_of([10 + 2 * i for i in range(len(LENGTHS))], list(LENGTHS))
    for scored in (None, counted):
        found = native.losses(runs, 2, scored, nobody)
        right = judge.losses(runs, 2, scored, nobody)
        for name, total in right.items():
            assert found[name].count == total.count
            assert found[name].total == pytest.approx(total.total, rel=FREE_RUN)


def test_a_long_run_goes_on_from_call_to_call(monkeypatch: pytest.MonkeyPatch) -> None:
    """Segments of 128 steps and calls of 256, with buffers that reach over both."""
    monkeypatch.setattr(rollout_kernel, "_AT_ONCE", 256)
    text, closed = MODELS["memory"]
    program = close_loop(compiled(text), closed)
    log, weights = log_of(program, 2000), initial(program)
    runs = runs_of([10, 20, 30, 1200], [1900, 700, 3, 512])
    told: list[int] = []
    native = NativeRollouts(program, weights, log)
    found = native.outputs(runs, told.append)
    right = interpreted_rollouts(program, weights, log).outputs(runs, nobody)
    assert_near(found["x_next"], right["x_next"], FREE_RUN)
    assert sum(told) == 1900 + 700 + 3 + 512
    assert len(told) == 8
    sums = native.losses(runs, 5, None, nobody)
    judged = interpreted_rollouts(program, weights, log).losses(runs, 5, None, nobody)
    for name, total in judged.items():
        assert sums[name].total == pytest.approx(total.total, rel=FREE_RUN)


def test_a_program_without_outputs_or_losses_runs_too() -> None:
    program = close_loop(compiled(MODELS["fir"][0]), ("x",))
    log, weights, runs = log_of(program), initial(program), runs_of([10], [5])
    alone = NativeRollouts(replace(program, outputs=()), weights, log)
    assert alone.outputs(runs, nobody) == {}
    assert (
        NativeRollouts(replace(program, losses=()), weights, log).losses(runs, 0, None, nobody)
        == {}
    )
