"""What the integers of a step mean: sets, saturation, inputs out of range, the first sample."""

from pathlib import Path

import numpy as np
import pytest

from msnn.features.fixed_point.compile.compile_integers import integer_program
from msnn.features.fixed_point.integers.interpret import FixedStatus, initial, reset, step
from msnn.features.fixed_point.integers.program import Q15, Q31, IntegerProgram
from tests.features.fixed_point.exported import fixed_model, initial_weights, planned

HEAD = "msnn: 1\nname: model\nsample_time: 1 s\n"


def _integers(folder: Path, text: str, dtype: str = "q15") -> IntegerProgram:
    plan = planned(fixed_model(folder, HEAD + text, dtype))
    weights = initial_weights(plan.program)
    return integer_program(plan.program, weights, Q15 if dtype == "q15" else Q31)


def _real(program: IntegerProgram, words: dict[str, list[int]], output: str) -> float:
    port = next(port for port, _ in program.outputs if port.name == output)
    return float(np.ldexp(words[output][0], -port.fraction))


def test_a_table_is_met_on_its_knots_and_is_straight_between_them(tmp_path: Path) -> None:
    text = """\
inputs: {u: {range: [-4, 4]}}
layers: {map: {interpolation: {x: [-3, -1, 0, 2], y: [1, -2, 4, 3]}}}
outputs: {y: map(u)}
"""
    program = _integers(tmp_path, text)
    (entry,) = program.inputs
    state = initial(program)
    for u in np.linspace(-4, 4, 65):
        word = round(float(np.ldexp(u, entry.port.fraction)))
        found = _real(program, step(program, state, {"u": [word]}).outputs, "y")
        # the words of the knots, of the values and of the result are rounded
        assert found == pytest.approx(np.interp(u, [-3, -1, 0, 2], [1, -2, 4, 3]), abs=6e-4)


def test_a_state_stops_at_its_range_and_says_so(tmp_path: Path) -> None:
    text = """\
inputs: {u: {range: [-1, 1]}}
states: {x: {next: x + u, init: 0, range: [-2, 2]}}
outputs: {y: x}
"""
    program = _integers(tmp_path, text)
    (entry,), (memory,) = program.inputs, program.memories
    state = initial(program)
    said = [step(program, state, {"u": [entry.port.high]}).status for _ in range(4)]
    assert said == [FixedStatus(0)] * 2 + [FixedStatus.STATE_SATURATED] * 2
    assert state.memories["x"] == [memory.high]
    assert memory.wide


def test_a_state_that_saturates_by_itself_is_no_fault(tmp_path: Path) -> None:
    """The words are those of a state that is flagged: it keeps all bits of a sum."""
    text = """\
inputs: {u: {range: [-1, 1]}}
states: {x: {next: 0.9 * x + u, init: 0, range: [-2, 2], on_range: saturate}}
outputs: {y: x}
"""
    program = _integers(tmp_path, text)
    flagged = _integers(tmp_path, text.replace(", on_range: saturate", ""))
    word = program.inputs[0].port.high
    states = [initial(program), initial(flagged)]
    for sign in [1, 1, 1, 1, -1, -1, -1, -1, -1, -1]:
        found = [
            step(p, s, {"u": [sign * word]})
            for p, s in zip((program, flagged), states, strict=True)
        ]
        assert found[0].outputs == found[1].outputs
        assert found[0].status == FixedStatus(0)
    assert states[0].memories == states[1].memories


@pytest.mark.parametrize(
    ("policy", "used", "status"),
    [
        ("clamp", 1.0, FixedStatus.CLAMPED),
        ("flag", 1.0, FixedStatus.CLAMPED | FixedStatus.OUT_OF_RANGE),
        ("hold", 0.5, FixedStatus.HELD),
    ],
)
def test_a_word_outside_its_range_is_replaced(
    policy: str, used: float, status: FixedStatus, tmp_path: Path
) -> None:
    text = f"""\
inputs: {{u: {{range: [-1, 1], on_invalid: {policy}}}}}
outputs: {{y: 0.75 * u}}
"""
    program = _integers(tmp_path, text)
    scale = 2 ** program.inputs[0].port.fraction
    state = initial(program)
    assert step(program, state, {"u": [scale // 2]}).status == FixedStatus(0)
    answer = step(program, state, {"u": [2 * scale - 1]})
    assert answer.status == status
    assert _real(program, answer.outputs, "y") == pytest.approx(0.75 * used, abs=1e-4)


def test_the_first_step_fills_the_past_of_an_input(tmp_path: Path) -> None:
    text = """\
inputs: {u: {range: [-1, 1]}}
outputs: {y: mean(u.past(4))}
"""
    program = _integers(tmp_path, text)
    word = program.inputs[0].port.high // 2
    answer = step(program, initial(program), {"u": [word]})
    assert _real(program, answer.outputs, "y") == pytest.approx(0.5, abs=1e-3)
    again = step(program, reset(program, {"u": [0, 0, 0]}), {"u": [word]})
    assert _real(program, again.outputs, "y") == pytest.approx(0.125, abs=1e-3)


@pytest.mark.parametrize("dtype", ["q15", "q31"])
def test_a_filter_keeps_within_the_bound_that_was_proved(dtype: str, tmp_path: Path) -> None:
    """The state has no range: |s| <= sum over k of |A^k| |d|, which a worst input comes near."""
    text = """\
inputs: {u: {range: [-1, 1]}}
states: {s: {next: 0.9 * s + u, init: 0}}
outputs: {y: s}
"""
    program = _integers(tmp_path, text, dtype)
    (memory,) = program.memories
    bound = float(np.ldexp(memory.high, -memory.fraction))
    assert 10.0 <= bound < 10.3
    state = initial(program)
    for _ in range(200):
        assert step(program, state, {"u": [program.inputs[0].port.high]}).status == 0
    assert 9.9 < float(np.ldexp(state.memories["s"][0], -memory.fraction)) <= 10.1


@pytest.mark.parametrize("dtype", ["q15", "q31"])
def test_words_of_a_range_that_ends_just_below_a_power_of_two_fit(
    tmp_path: Path, dtype: str
) -> None:
    """Rounded at the finest scale such an end would be 2^15, which is no 16-bit integer."""
    text = """\
inputs: {u: {range: [0, 0.9999999999]}, v: {range: [-1.9999999999, 0]}}
states: {x: {next: 0.5*x + 0.25*u, init: 0, range: [-0.9999999999, 0.5]}}
outputs: {y: 0.25*x + 0.25*u + 0.125*v}
"""
    program = _integers(tmp_path, text, dtype)
    width = program.width
    ports = {entry.port.name: entry.port for entry in program.inputs}
    for port in ports.values():
        assert max(-port.low, port.high) <= width.largest_word
    (memory,) = program.memories
    limit = width.largest_sum if memory.wide else width.largest_word
    assert max(-memory.low, memory.high) <= limit
    # the highest words still mean the ends of the ranges, to half a unit
    end = float(np.ldexp(ports["u"].high, -ports["u"].fraction))
    assert end == pytest.approx(0.9999999999, abs=float(np.ldexp(0.5, -ports["u"].fraction)))
    answer = step(program, initial(program), {"u": [ports["u"].high], "v": [ports["v"].high]})
    assert answer.status == FixedStatus(0)
    assert _real(program, answer.outputs, "y") == pytest.approx(0.25, abs=1e-3)
