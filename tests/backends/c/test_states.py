"""How a controller begins, and how its memory moves."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from backends.c import COptions
from backends.c_lowering.options import Ring
from compiler.ir.builder import GraphBuilder
from compiler.ir.program import Declared, Role, Signal, State
from compiler.ir.types import WINDOW, Axis, Type
from tests.backends.c.c_programs import assert_same_bits, built, closed_sample, golden, replay
from tests.backends.c.small_programs import filtered, program, starting_states, swapped_states

RINGS: tuple[Ring, ...] = ("shift", "double")


@pytest.mark.parametrize("ring", RINGS)
def test_the_first_step_after_init_fills_buffers_with_its_own_sample(
    ring: Ring, tmp_path: Path
) -> None:
    step = built(filtered("flag", None, cells=True), tmp_path, COptions(ring=ring))
    uninitialised = step.status_bits["SMALL_STATUS_UNINITIALISED"]
    step.init()
    first = np.array([3.0, -1.5, 0.75])
    outputs, status = step.step({"u": first})
    assert status == uninitialised
    np.testing.assert_allclose(outputs["mean"], first, rtol=1e-6)  # 1/3 is rounded
    outputs, status = step.step({"u": np.zeros(3)})
    assert status == 0
    np.testing.assert_allclose(outputs["mean"], first * 2 / 3, rtol=1e-6)
    np.testing.assert_array_equal(step.states()["u.history"], np.stack([first, 0 * first], axis=1))


@pytest.mark.parametrize("ring", RINGS)
def test_init_makes_an_instance_as_new(ring: Ring, tmp_path: Path) -> None:
    step = built(filtered("flag", None, cells=False), tmp_path, COptions(ring=ring))
    series = {"u": np.linspace(-2, 2, 7)}
    step.init()
    first = step.run(series, 7)
    step.init()
    second = step.run(series, 7)
    assert np.array_equal(first[0]["mean"], second[0]["mean"])
    assert np.array_equal(first[1], second[1])


def test_init_sets_what_needs_no_record_and_says_what_is_missing(tmp_path: Path) -> None:
    step = built(starting_states(), tmp_path, COptions())
    uninitialised = step.status_bits["SMALL_STATUS_UNINITIALISED"]
    step.init()
    outputs, status = step.step({"u": 0.0})
    assert {name: float(value) for name, value in outputs.items()} == {
        "fixed": 0.25,
        "measured": 0.0,
        "encoded": 0.0,
    }
    assert status == uninitialised
    assert step.step({"u": 0.0})[1] == uninitialised


def test_a_buffer_that_is_filled_makes_no_state_ready_that_waits_for_reset(tmp_path: Path) -> None:
    """The first step after `init` fills the past of an input; what `v` measured it cannot know."""
    b, starts = GraphBuilder(), GraphBuilder()
    past = b.element(b.signal("u", -2, 0, Type((Axis(WINDOW, 3),))), WINDOW, 0)
    x = b.state("x", Type())
    state = State("x", (), None, Declared(), b.add(x, past), starts.log("v", 0, 0, Type()))
    signals = [Signal("u", Role.INPUT), Signal("v", Role.TARGET)]
    waiting = program(b, {"x": x, "past": past}, signals, states=[state], starts=starts)
    step = built(waiting, tmp_path, COptions())
    uninitialised = step.status_bits["SMALL_STATUS_UNINITIALISED"]
    step.init()
    for _ in range(4):
        assert step.step({"u": 1.0})[1] == uninitialised
    step.reset({"u": np.zeros(2), "v": np.zeros(())})
    assert step.step({"u": 1.0})[1] == 0


def test_reset_takes_samples_and_the_states_that_start_from_the_future(tmp_path: Path) -> None:
    step = built(starting_states(), tmp_path, COptions())
    step.reset({"v": 4.0, "encoded": -8.0})
    outputs, status = step.step({"u": 0.0})
    assert {name: float(value) for name, value in outputs.items()} == {
        "fixed": 0.25,
        "measured": 4.0,
        "encoded": -8.0,
    }
    assert status == 0


def test_a_state_outside_its_range_is_reported(tmp_path: Path) -> None:
    step = built(starting_states(), tmp_path, COptions())
    step.reset({"v": 0.0, "encoded": 0.0})
    assert step.step({"u": 0.5})[1] == 0
    assert step.step({"u": 10.0})[1] == step.status_bits["SMALL_STATUS_STATE_OUT_OF_RANGE"]


def test_states_are_committed_all_at_once(tmp_path: Path) -> None:
    for ring in RINGS:
        program, options = swapped_states(), COptions(ring=ring)
        vectors = golden(program, options, 40, seed=1)
        step = built(program, tmp_path / ring, options)
        outputs, _ = replay(step, vectors)
        assert_same_bits(outputs, vectors.outputs)
        assert list(outputs["left"][1]) == [-1.0, -2.0, -4.0]


@pytest.mark.parametrize("ring", RINGS)
def test_a_corrupted_ring_position_reaches_nothing_outside(ring: Ring, tmp_path: Path) -> None:
    step = built(filtered("flag", None, cells=False), tmp_path, COptions(ring=ring))
    step.init()
    step._state.view(np.uint8)[...] = 0xFF
    outputs, _ = step.step({"u": 1.0})
    assert float(outputs["now"]) == 1.0


def test_state_values_are_the_interpreters(tmp_path: Path) -> None:
    from compiler.interpreter.interpreter import Interpreter

    program = closed_sample("joint_arm")
    log = {"q": np.linspace(-1, 1, 60).reshape(20, 3), "tau": np.ones((20, 3))}
    judge = Interpreter(program, dtype=np.float32)
    states = judge.start(log, 6)
    for ring in RINGS:
        step = built(program, tmp_path / ring, COptions(ring=ring))
        step.reset({"q": np.moveaxis(log["q"][3:7], 0, -1)})
        current = states
        for t in range(6, 12):
            step.step({"tau": log["tau"][t]})
            current = judge.step(log, t, current, losses=False).next_states
            assert_same_bits(step.states(), {k: v[0] for k, v in current.items()})
