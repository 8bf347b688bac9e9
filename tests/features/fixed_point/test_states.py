"""What C in fixed point says of its states and of the samples that they begin with."""

import subprocess
from pathlib import Path

import numpy as np
import pytest

from backends.c.host.build import build_library
from backends.c.host.library import CStep
from msnn.exports.export import plan_exports, write_export
from msnn.features.fixed_point.compile.compile_integers import integer_program
from msnn.features.fixed_point.integers.interpret import FixedStatus, initial, reset, step
from msnn.features.fixed_point.integers.program import Q15, Q31, IntegerProgram
from spec_schema.diagnostics.diagnostic import Findings
from tests.conditions import require_tool
from tests.features.fixed_point.exported import (
    fixed_model,
    initial_weights,
    planned,
    run_test_program,
)

SPEC = """\
msnn: 1
name: model
sample_time: 1 s
dims: {joint: 2}
inputs: {u: {dims: joint, range: [-1, 1]}}
states:
  x: {dims: joint, next: x + u, init: 0.5, range: [-2, 2], on_range: POLICY}
  v: {next: "0.5 * v + part(u, 0)", init: v.meas, range: [-2, 2], on_range: saturate}
outputs: {y: "x + v", z: mean(u.past(3))}
"""


def _built(folder: Path, text: str) -> tuple[IntegerProgram, CStep]:
    require_tool("gcc", "apt-get install gcc")
    plan = planned(fixed_model(folder, text, "q15"))
    integers = integer_program(plan.program, initial_weights(plan.program), Q15)
    write_export(plan, {}, folder / "c")
    library = build_library(folder / "c", folder / "model.so", ["gcc"], ["-O1", "-Wall", "-Werror"])
    return integers, CStep.of_folder(folder / "c", library)


@pytest.mark.parametrize("policy", ["flag", "saturate", "reset"])
def test_c_does_with_states_outside_their_range_what_the_integers_do(
    policy: str, tmp_path: Path
) -> None:
    integers, model = _built(tmp_path, SPEC.replace("POLICY", policy))
    random = np.random.default_rng(3)
    ports = {entry.port.name: entry.port for entry in integers.inputs}
    words = random.integers(ports["u"].low, ports["u"].high, (300, 2))
    words[::3] = ports["u"].high
    state = initial(integers)
    model.init()
    found, status = model.run({"u": words.astype(np.int16)}, 300)
    said: list[int] = []
    for k in range(300):
        answer = step(integers, state, {"u": words[k].tolist()})
        assert found["y"][k].tolist() == answer.outputs["y"]
        said.append(int(answer.status))
    assert status.tolist() == said
    saturated = FixedStatus.STATE_SATURATED
    assert any(bits & saturated for bits in said) == (policy != "saturate")


def test_a_state_with_reset_goes_back_to_init_as_a_whole(tmp_path: Path) -> None:
    integers, _ = _built(tmp_path, SPEC.replace("POLICY", "reset"))
    ports = {entry.port.name: entry.port for entry in integers.inputs}
    first, state = initial(integers).memories["x"], initial(integers)
    for bits in (0, FixedStatus.STATE_SATURATED):
        answer = step(integers, state, {"u": [ports["u"].high, 0]})
        assert answer.status & FixedStatus.STATE_SATURATED == bits
    assert state.memories["x"] == first


def test_reset_says_which_samples_it_moved_and_a_struct_of_zeros_that_it_is_one(
    tmp_path: Path,
) -> None:
    integers, model = _built(tmp_path, SPEC.replace("POLICY", "saturate"))
    zero = {"u": np.zeros(2, np.int16)}
    assert model.step(zero)[1] == FixedStatus.UNINITIALISED
    model.init()
    assert model.step(zero)[1] == FixedStatus.UNINITIALISED  # v is known to reset alone
    windows = {name: np.zeros(shape, np.int16) for name, shape in model.start_shapes.items()}
    assert model.reset(windows) == 0
    assert model.step(zero)[1] == 0
    windows["v"] = np.full_like(windows["v"], 32767)
    listed = {name: words.ravel().tolist() for name, words in windows.items()}
    assert model.reset(windows) == reset(integers, listed).said == FixedStatus.CLAMPED


def test_reset_moves_samples_of_an_input_that_no_step_moves(tmp_path: Path) -> None:
    """`hold` never moves a sample: the header has the bit for the past that `reset` is given."""
    held = "inputs: {u: {range: [-1.5, 1.5], on_invalid: hold}}\noutputs: {y: mean(u.past(3))}\n"
    integers, model = _built(tmp_path, f"msnn: 1\nname: model\nsample_time: 1 s\n{held}")
    windows = {name: np.full(shape, 32767) for name, shape in model.start_shapes.items()}
    listed = {name: words.ravel().tolist() for name, words in windows.items()}
    said = reset(integers, listed).said
    windows = {name: words.astype(np.int16) for name, words in windows.items()}
    assert model.reset(windows) == said == FixedStatus.CLAMPED


def test_the_test_program_sees_a_reset_that_does_not_say_what_it_moved(tmp_path: Path) -> None:
    _built(tmp_path, SPEC.replace("POLICY", "saturate"))
    run_test_program(tmp_path / "c", "model", "gcc", ())
    source = tmp_path / "c" / "src" / "model.c"
    text = source.read_text(encoding="utf-8")
    begin = text.index("_reset(")
    said = "status |= MODEL_STATUS_CLAMPED;"
    assert said in text[begin:]
    changed = text[begin:].replace(said, "", 1)
    source.write_text(text[:begin] + changed, encoding="utf-8")
    with pytest.raises(subprocess.CalledProcessError):
        run_test_program(tmp_path / "c", "model", "gcc", ())


def test_a_flagged_state_that_saturates_all_the_same_is_a_warning(tmp_path: Path) -> None:
    for policy, codes in (("flag", ["W0746"]), ("saturate", []), ("reset", [])):
        model = fixed_model(tmp_path, SPEC.replace("POLICY", policy), "q15")
        findings = Findings()
        plan_exports(model, ["c"], findings)
        assert [diagnostic.code for diagnostic in findings.in_order] == codes


_GROWS_FIRST = "{next: 0.5 * a + 4 * b}", "{next: 0.5 * b + GAIN * u, init: 1}"


@pytest.mark.parametrize(
    ("first", "second"),
    [
        # what b begins with moves a far from where that begins, before both fade
        (_GROWS_FIRST[0], _GROWS_FIRST[1].replace("GAIN", "0.001")),
        # what both begin with and what the input adds to it
        (_GROWS_FIRST[0], _GROWS_FIRST[1].replace("GAIN", "0.2")),
        # what hundreds of inputs add
        ("{next: 0.995 * a + 0.005 * u}", "{next: 0.99 * b + 0.01 * a}"),
    ],
)
def test_no_input_leads_out_of_ranges_that_are_proved(
    first: str, second: str, tmp_path: Path
) -> None:
    text = f"""\
msnn: 1
name: model
sample_time: 1 s
inputs: {{u: {{range: [-1, 1]}}}}
states: {{a: {first}, b: {second}}}
outputs: {{y: a + b}}
"""
    plan = planned(fixed_model(tmp_path, text, "q31"))
    integers = integer_program(plan.program, initial_weights(plan.program), Q31)
    (port,) = (entry.port for entry in integers.inputs)
    for word in (port.low, port.high):
        state = initial(integers)
        said = [step(integers, state, {"u": [word]}).status for _ in range(2500)]
        assert not any(bits & FixedStatus.STATE_SATURATED for bits in said)
