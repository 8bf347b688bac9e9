"""What generated C says of its states, and how a state that is wrong is left again."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np
import pytest

from backends.c import COptions
from backends.c.host.library import CStep
from backends.c.interface.status import StatusBit
from compiler.passes.to_step_form import to_step_form
from tests.backends.c.c_programs import assert_same_bits, built, golden, replay
from tests.language.compiled import compiled

NAN = float("nan")
POLICIES = """
dims: {joint: 3}
inputs: {u: {dims: joint, range: [-2, 2]}, z: {range: [-1, 1]}}
parameters: {first: 0.25}
states:
  a: {dims: joint, next: "a + u", init: first, range: [-3, 3], on_range: POLICY}
  b: {next: "0.9 * b + sqrt(z) + part(u, 0)", init: 0.5, range: [-1, 2], on_range: POLICY}
  c: {next: "0.5 * c + z"}
outputs: {y: "sum(a) + b + c", m: "mean(z.past(4))"}
"""


def _built(text: str, folder: Path, options: COptions = COptions()) -> CStep:  # noqa: B008
    return built(to_step_form(compiled(text)), folder, options)


@pytest.mark.parametrize("constant_time", [False, True])
@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("policy", ["flag", "saturate", "reset"])
def test_golden_steps_with_states_outside_their_range(
    policy: str, dtype: Literal["float32", "float64"], constant_time: bool, tmp_path: Path
) -> None:
    program = to_step_form(compiled(POLICIES.replace("POLICY", policy)))
    options = COptions(dtype=dtype, constant_time=constant_time)
    vectors = golden(program, options, 80, seed=4)
    left = (vectors.status & StatusBit.STATE_OUT_OF_RANGE) != 0
    assert left.any()
    assert left.all() == (policy == "flag")  # a NaN, of which a flag does not take anything back
    outputs, status = replay(built(program, tmp_path, options), vectors)
    if dtype == "float32":
        assert_same_bits(outputs, vectors.outputs)
    np.testing.assert_array_equal(status, vectors.status)


@pytest.mark.parametrize("constant_time", [False, True])
def test_a_state_with_reset_goes_back_to_init_as_a_whole(
    constant_time: bool, tmp_path: Path
) -> None:
    text = """
        dims: {joint: 2}
        inputs: {u: {dims: joint}}
        parameters: {first: 0.25}
        states:
          a: {dims: joint, next: a + u, init: 2 * first, range: [-1, 1], on_range: reset}
          b: {next: "b + part(u, 0)", range: [-9, 9]}
        outputs: {y: a, z: b}
    """
    options = COptions(dtype="float64", constant_time=constant_time, params="tunable")
    step = _built(text, tmp_path, options)
    step.tune({"first": 0.125})
    step.init()
    _, status = step.run({"u": np.array([[0.5, 0.5], [0.0, 0.5], [0.0, NAN], [0.25, 0.25]])}, 4)
    np.testing.assert_array_equal(step.states()["a"], [0.5, 0.5])
    assert step.states()["b"] == 0.75
    outside, unordered = StatusBit.STATE_OUT_OF_RANGE, StatusBit.NOT_A_NUMBER
    assert status.tolist() == [0, outside, outside | unordered, 0]


def test_a_saturated_state_is_reported_for_nan_alone(tmp_path: Path) -> None:
    text = """
        inputs: {u: {on_invalid: trust}}
        states: {a: {next: a + u, range: [-1, 1], on_range: saturate}}
        outputs: {y: next(a)}
    """
    step = _built(text, tmp_path)
    step.init()
    outputs, status = step.run({"u": np.array([0.5, 3.0, NAN, -np.inf])}, 4)
    np.testing.assert_array_equal(outputs["y"], np.array([0.5, 1, 1, -1], np.float32))
    assert status.tolist() == [0, 0, StatusBit.STATE_OUT_OF_RANGE, 0]


LOOPS = {
    "declared": "states: {a: {next: 0.5 * a + u}}\noutputs: {y: a}",
    "memory": "outputs: {y: integral(u)}",
    "delay line": "equations: {e: {expr: '0.5 * e[t-1] + u', history: 0}}\noutputs: {y: e}",
    "window": "equations: {e: {expr: '0.1 * sum(e[t-4:t-1]) + u', history: 0}}\noutputs: {y: e}",
}


@pytest.mark.parametrize("ring", ["shift", "double"])
@pytest.mark.parametrize("kind", list(LOOPS))
def test_a_state_that_became_nan_says_so_until_init_or_reset(
    kind: str, ring: Literal["shift", "double"], tmp_path: Path
) -> None:
    step = _built(
        f"inputs: {{u: {{on_invalid: trust}}}}\n{LOOPS[kind]}", tmp_path, COptions(ring=ring)
    )
    windows = {name: np.zeros(shape) for name, shape in step.start_shapes.items()}
    for begin in (step.init, lambda: step.reset(windows)):
        begin()
        _, status = step.run({"u": np.array([1.0, NAN, *np.zeros(30)])}, 32)
        waits = StatusBit.UNINITIALISED if begin == step.init and windows else StatusBit(0)
        assert status[0] & ~waits == 0
        assert (status[1:] & StatusBit.STATE_NOT_FINITE).all()
    step.reset(windows)
    _, status = step.run({"u": np.zeros(32)}, 32)
    assert not status.any()


def test_a_window_of_an_input_forgets_a_nan_by_itself(tmp_path: Path) -> None:
    step = _built("inputs: {u: {}}\noutputs: {y: mean(u.past(4))}", tmp_path)
    assert step.reset({"u": np.zeros(3)}) == 0
    _, status = step.run({"u": np.array([0.0, NAN, 0.0, 0.0])}, 4)
    assert status.tolist() == [0, StatusBit.NOT_A_NUMBER, 0, 0]


@pytest.mark.parametrize("constant_time", [False, True])
@pytest.mark.parametrize(
    "text",
    [
        "inputs: {u: {}}\nstates: {a: {next: 0.5 * a + u}}\noutputs: {y: a}",
        "inputs: {u: {}}\noutputs: {y: mean(u.past(4))}",
        "inputs: {u: {on_invalid: hold}}\noutputs: {y: u}",
        "inputs: {u: {}}\nstates: {a: {next: 0.5 * a + u, init: a.meas}}\noutputs: {y: a}",
    ],
    ids=["init", "buffer", "held", "measured"],
)
def test_a_struct_of_zeros_says_that_it_was_never_initialised(
    text: str, constant_time: bool, tmp_path: Path
) -> None:
    step = _built(text, tmp_path, COptions(constant_time=constant_time, extras=("jacobian",)))
    for _ in range(3):
        assert step.step({"u": 0.0})[1] == StatusBit.UNINITIALISED
    assert step.linearize({"u": 0.0})[1] == StatusBit.UNINITIALISED
    assert step.reset({name: np.zeros(shape) for name, shape in step.start_shapes.items()}) == 0
    assert step.step({"u": 0.0})[1] == 0


@pytest.mark.parametrize(
    ("policy", "samples", "seen", "bits"),
    [
        ("flag", [0.5, NAN, 3.0], [0.5, NAN, 3.0], StatusBit.OUT_OF_RANGE | StatusBit.NOT_A_NUMBER),
        ("clamp", [NAN, 3.0, -3.0], [0.0, 1.0, -1.0], StatusBit.CLAMPED | StatusBit.NOT_A_NUMBER),
        ("hold", [3.0, 0.5, NAN], [0.0, 0.5, 0.5], StatusBit.HELD | StatusBit.NOT_A_NUMBER),
        ("hold", [0.25, 3.0, 3.0], [0.25, 0.25, 0.25], StatusBit.HELD),
        ("trust", [NAN, 3.0, 0.5], [NAN, 3.0, 0.5], StatusBit(0)),
        ("clamp", [0.5, -0.5, 1.0], [0.5, -0.5, 1.0], StatusBit(0)),
    ],
)
@pytest.mark.parametrize("constant_time", [False, True])
def test_reset_checks_its_samples_as_step_does(
    policy: str,
    samples: list[float],
    seen: list[float],
    bits: StatusBit,
    constant_time: bool,
    tmp_path: Path,
) -> None:
    text = f"""
        inputs: {{u: {{range: [-1, 1], on_invalid: {policy}}}}}
        outputs: {{y: mean(u.past(4))}}
    """
    step = _built(text, tmp_path, COptions(dtype="float64", constant_time=constant_time))
    assert step.reset({"u": np.array(samples)}) == bits
    (kept,) = step.states().values()
    np.testing.assert_array_equal(kept, seen)


def test_reset_says_that_a_state_begins_outside_its_range(tmp_path: Path) -> None:
    text = """
        inputs: {u: {}}
        states:
          a: {next: a + u, init: a.meas, range: [-1, 1]}
          b: {next: b + u, init: b.meas}
        outputs: {y: a + b}
    """
    step = _built(text, tmp_path)
    assert step.reset({"a": 1.0, "b": 9.0}) == 0
    assert step.reset({"a": 1.5, "b": 0.0}) == StatusBit.STATE_OUT_OF_RANGE | StatusBit.OUT_OF_RANGE
    assert step.reset({"a": 0.0, "b": NAN}) == StatusBit.STATE_NOT_FINITE | StatusBit.NOT_A_NUMBER
