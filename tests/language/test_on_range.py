"""What becomes of a state's next value outside its range: reported, kept at the end, reset."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from compiler.interpreter.interpreter import Interpreter
from compiler.program_file.file import program_from_json, program_to_json
from tests.language.compiled import codes, compiled
from tests.language.submodels.submodels import model_of, run
from tests.language.targets.every_backend import assert_backends_agree

SATURATED = """
dims: {joint: 2}
inputs: {u: {unit: m, dims: joint}, v: {}}
states:
  s: {unit: m, dims: joint, next: "s + u", range: [-3 m, 150 cm], on_range: saturate}
  w: {der: sqrt(v), range: [-1, 2], on_range: saturate}
outputs: {y: "sum(s) + w", after: "sum(next(s)) + next(w)"}
"""


def test_a_saturated_state_is_clipped_and_keeps_its_value_for_nan() -> None:
    program = compiled(SATURATED)
    judge = Interpreter(program)
    states = {"s": np.array([[1.0, -2.5]]), "w": np.array([1.5])}
    log = {"u": np.array([[1.0, -1.0]]), "v": np.array([-1.0])}
    following = judge.step(log, 0, states).next_states
    np.testing.assert_array_equal(following["s"], [[1.5, -3.0]])
    np.testing.assert_array_equal(following["w"], [1.5])
    log = {"u": np.array([[np.nan, -np.inf]]), "v": np.array([np.inf])}
    following = judge.step(log, 0, states).next_states
    np.testing.assert_array_equal(following["s"], [[1.0, -3.0]])
    np.testing.assert_array_equal(following["w"], [2.0])


def test_every_backend_saturates() -> None:
    random = np.random.default_rng(1)
    log = {"u": 3 * random.normal(size=(20, 2)), "v": 90 * random.normal(size=20)}
    assert (log["v"][[0, 3, 5, 9, 12]] < 0).any()  # NaN as the derivative of w
    assert_backends_agree(SATURATED, log, [0, 3, 5, 9, 12])


def test_the_slope_of_a_saturated_state_is_1_on_the_bound() -> None:
    text = """
        inputs: {u: {}}
        parameters: {p: {init: 1.0}}
        states: {s: {next: "p * u", range: [-1, 1], on_range: saturate}}
        outputs: {y: next(s)}
    """
    from compiler.jacobian.jacobian import JacobianInterpreter, jacobian
    from compiler.passes.simplify import prune_outputs

    program = prune_outputs(compiled(text), ["y"])
    linear = JacobianInterpreter(jacobian(program, parameters=False), program, {}, "float64")
    for u, slope in [(1.0, 1.0), (-1.0, 1.0), (0.5, 1.0), (1.001, 0.0), (-2.0, 0.0)]:
        matrices = linear.matrices({"u": np.array([u])}, 0, {"s": np.zeros(1)})
        np.testing.assert_array_equal(matrices["B"].ravel(), [slope])


@pytest.mark.parametrize("policy", ["saturate", "reset"])
def test_a_program_file_keeps_what_becomes_of_a_state_outside_its_range(policy: str) -> None:
    program = compiled(SATURATED.replace("saturate", policy))
    assert program.state("s").on_range == policy
    assert program_from_json(program_to_json(program), "test") == program


def test_flag_and_reset_change_nothing_in_the_model() -> None:
    plain = compiled(SATURATED.replace(", on_range: saturate", ""))
    for policy in ("flag", "reset"):
        program = compiled(SATURATED.replace("saturate", policy))
        assert program.step == plain.step
        assert program.start == plain.start


def test_what_acts_on_a_range_needs_one() -> None:
    text = "inputs: {u: {}}\nstates: {s: {next: u, on_range: POLICY}}\noutputs: {y: s}"
    for policy in ("flag", "saturate", "reset"):
        assert codes(text.replace("POLICY", policy)) == ["E0741"]


def test_a_reset_needs_an_init_that_is_known_without_the_log() -> None:
    text = """
        inputs: {u: {}}
        states: {s: {next: u, init: INIT, range: [0, 1], on_range: reset}}
        outputs: {y: s}
    """
    assert codes(text.replace("INIT", "s.meas")) == ["E0742"]
    assert codes(text.replace("INIT", "0.5")) == []


def test_a_state_of_a_part_saturates_too(tmp_path: Path) -> None:
    part = """
        inputs: {u: {}}
        states: {s: {next: s + u, range: [-1, 1], on_range: saturate}}
        outputs: {y: next(s)}
        """
    text = """
        use: {part: {spec: part.yaml}}
        inputs: {r: {}}
        connect: {part.u: r}
        outputs: {y: part.y}
        """
    program = model_of(tmp_path, text, part=part).program
    assert program.state("part.s").on_range == "saturate"
    assert run(program, {"r": [0.7, 0.7, 0.7]}, steps=3).tolist() == [0.7, 1.0, 1.0]
