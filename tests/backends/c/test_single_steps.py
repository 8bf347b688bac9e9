"""Single golden steps: next to where C decides, where one slope alone is infinite, and few."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from backends.c import COptions, write_c
from backends.c.interface.interface import Interface, c_interface
from backends.c.selftest.drawn_inputs import StartPoint
from backends.c.selftest.golden_vectors import GoldenRun, golden_runs
from backends.c.selftest.selftest_text import expected_text
from backends.c.selftest.singles.boundaries import (
    between,
    codes_of,
    descended,
    distance,
    numbers_of,
)
from backends.c.selftest.singles.decisions import Decisions
from backends.c.selftest.singles.drawn_trials import drawn_trials
from backends.c.selftest.singles.golden_singles import GoldenSingles, golden_singles
from backends.c.selftest.singles.trial_steps import TrialSteps
from backends.c_lowering.options import ParameterAccess
from compiler.interpreter.interpreter import physical_weights
from compiler.ir.program import Program
from compiler.passes.to_step_form import to_step_form
from tests.backends.c.c_programs import program_said
from tests.language.compiled import compiled

_LIMITED = """
inputs: {u: {range: [-10, 10], on_invalid: clamp}}
parameters: {gain: 0.7}
outputs: {y: {expr: "where(gain * u > 3, 1.5, 0.5)"}}
"""
_LEARNED_KNOTS = """
inputs: {slope: {range: [-9, 9]}}
layers: {moving: {fuzzify: {centers: [-4, 4], learn: true}}}
outputs: {y: {expr: sum(moving(slope))}}
"""
_TWO_ROOTS = """
inputs: {u: {range: [0, 9], on_invalid: clamp}, v: {range: [0, 9], on_invalid: clamp}}
parameters: {a: 1, b: 1}
outputs: {y: {expr: a * sqrt(u)}, z: {expr: b * sqrt(u) * v}}
"""
_ALMOST_EQUAL_SLOPES = """
inputs: {u: {range: [-1, 1], on_invalid: clamp}, v: {range: [1, 9], on_invalid: clamp}}
parameters: {a: 1.3, b: 0.7}
outputs: {y: {expr: 3 * u / (a * (v + b))}, z: {expr: 2.99 * u / (a * (v + b))}}
"""
_TWO_RANGES = """
sample_time: 100 ms
inputs: {u: {range: [-1, 1], on_invalid: clamp}}
states:
  p: {next: 0.5 * p + u, init: 0, range: [-3, 3]}
  q: {next: 0.5 * q - u, init: 0, range: [-40, 40]}
outputs: {y: {expr: p + q}}
"""
_SEVERAL = """
sample_time: 100 ms
dims: {axis: 3}
inputs: {v: {dims: axis, range: [-1, 1], on_invalid: clamp}}
states: {p: {next: 0.5 * p + sum(v), init: 0, range: [-3, 4]}}
outputs: {y: {expr: abs(v)}, z: {expr: p}}
"""
_HIDDEN_STATE = """
sample_time: 100 ms
inputs: {u: {range: [-1, 1]}}
parameters: {k: 0.7}
states: {x: {next: "0.5 * x + where(u - x > 0, k, 0.5) * (u - x)", init: 0}}
outputs: {y: {expr: x}}
"""
_ROUNDED_SUM = """
inputs: {u: {range: [1, 9], on_invalid: clamp}, v: {range: [1, 9], on_invalid: clamp}}
outputs: {y: {expr: "abs(0.37 * exp(2.3 * u) * v - 171.7 * v * v * u)"}}
"""


def _made(text: str) -> tuple[Program, Interface]:
    program = to_step_form(compiled(text))
    return program, c_interface(program, COptions(extras=("jacobian",)))


def _singles(text: str) -> GoldenSingles:
    program, interface = _made(text)
    weights = physical_weights(program, {})
    (run,) = golden_runs(program, interface, weights, 1, [GoldenRun(0, StartPoint())])
    found = golden_singles(program, interface, weights, [run.start], 5)
    assert found is not None
    return found


_TINY_QUOTIENT = """
inputs: {u: {range: [0, 3], on_invalid: clamp}}
parameters: {k: {init: 0.5, min: 0.1}}
outputs: {y: {expr: "abs(cos(u) / k)"}}
"""
_DIVIDEND_THAT_ENDS = """
inputs:
  u: {range: [1, 3], on_invalid: clamp}
  v: {range: [1, 9], on_invalid: clamp}
  w: {range: [0, 2], on_invalid: clamp}
parameters: {k: {init: 0.5, min: 0.1}}
outputs: {y: {expr: "abs((2.5 - v * u * exp(w - k)) / k)"}}
"""


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_codes_of_neighbours_differ_by_one(dtype: type[np.floating]) -> None:
    numbers = np.array([-np.inf, -1.5, -1e-40, 0.0, 1e-40, 0.3, 7e5], dtype)
    codes = codes_of(numbers)
    assert np.array_equal(numbers_of(codes, np.dtype(dtype)), numbers)
    assert np.array_equal(codes_of(np.nextafter(numbers, dtype(np.inf))), codes + 1)
    assert np.all(np.diff(codes) > 0)


def test_halving_ends_at_neighbours() -> None:
    low, high = codes_of(np.array([-2.5, 1e30, -0.0])), codes_of(np.array([1e300, -7.0, 4.0]))
    for _ in range(66):
        middle = between(low, high)
        assert np.all(np.minimum(low, high) <= middle)
        assert np.all(middle <= np.maximum(low, high))
        low = np.where(middle == low, low, middle)
    assert np.all(np.abs(high - low) <= 1)


def test_distances_are_right_over_all_numbers() -> None:
    """From the least to the largest number of float64 there are more than an int64 counts to."""
    largest = codes_of(np.array([np.finfo(np.float64).max]))
    assert distance(-largest, largest).tolist() == [2 * int(largest[0])]
    assert distance(largest, -largest).tolist() == [2 * int(largest[0])]
    assert distance(np.array([-3, 7]), np.array([4, 7])).tolist() == [7, 0]


def test_steps_stand_within_a_hundredth_of_a_threshold_on_both_sides() -> None:
    found = _singles(_LIMITED)
    gain = np.array([tuned.get(0, 0.7) for tuned in found.tuned], np.float32)
    compared = gain * found.vectors.inputs["u"]
    assert np.any((compared > 3.0) & (compared <= 3.031))
    assert np.any((compared <= 3.0) & (compared > 2.97))


def test_a_sum_of_rounded_products_is_exactly_0_in_some_step() -> None:
    singles = _singles(_ROUNDED_SUM)
    assert np.any(singles.vectors.outputs["y"] == 0.0)


def test_a_quotient_is_0_where_moves_make_it_less_and_less() -> None:
    """It is 0 only where the cosine and one through the parameter are tiny together."""
    program, interface = _made(_TINY_QUOTIENT)
    weights = physical_weights(program, {})
    (run,) = golden_runs(program, interface, weights, 1, [GoldenRun(0, StartPoint())])
    steps, random = TrialSteps(program, interface, weights, [run.start]), np.random.default_rng(0)
    decisions, drawn = Decisions(program, interface), drawn_trials(steps, random)
    drawn = drawn.of(np.flatnonzero(np.isfinite(drawn.numbers).all(axis=1)))
    assert not np.any(steps.run(drawn).outputs["y"] == 0.0)
    found = descended(steps, decisions, drawn, decisions.every, random)
    assert np.any(steps.run(found).outputs["y"] == 0.0)


def test_a_dividend_becomes_0_where_the_divisor_is_held() -> None:
    """The quotient is small wherever k is huge, and there the dividend is 2.5 for ever."""
    program, interface = _made(_DIVIDEND_THAT_ENDS)
    weights = physical_weights(program, {})
    (run,) = golden_runs(program, interface, weights, 1, [GoldenRun(0, StartPoint())])
    steps, random = TrialSteps(program, interface, weights, [run.start]), np.random.default_rng(2)
    decisions, drawn = Decisions(program, interface), drawn_trials(steps, random)
    drawn = drawn.of(np.flatnonzero(np.isfinite(drawn.numbers).all(axis=1)))
    found = descended(steps, decisions, drawn, decisions.every, random, held=0.5)
    assert np.any(steps.run(found).outputs["y"] == 0.0)


def test_each_slope_that_can_be_infinite_is_so_alone() -> None:
    found = _singles(_TWO_ROOTS)
    slopes = found.vectors.slopes["D"][: found.linearized].reshape(found.linearized, -1)
    # dy/du and dz/du: y does not depend on v, and dz/dv is a root
    endless = np.isinf(slopes)[:, [0, 2]]
    assert (endless & (endless.sum(axis=1, keepdims=True) == 1)).any(axis=0).tolist() == [True] * 2


def test_a_slope_is_infinite_where_another_is_hardly_finite() -> None:
    """Both have the same divisor, and one is 0.3 % larger."""
    found = _singles(_ALMOST_EQUAL_SLOPES)
    slopes = np.abs(found.vectors.slopes["D"][: found.linearized, :, 0])
    assert np.any((slopes[:, 0] == np.inf) & (slopes[:, 1] < np.inf))


def test_a_state_leaves_its_range_while_the_other_does_not() -> None:
    found = _singles(_TWO_RANGES)
    for name, limit in (("p", 3.0), ("q", 40.0)):
        other = {"p": ("q", 40.0), "q": ("p", 3.0)}[name]
        values, others = (np.abs(found.vectors.states[n]) for n in (name, other[0]))
        assert np.any((values > limit) & (values < 1.01 * limit) & (others <= other[1]))


def test_what_a_single_step_leaves_in_the_states_is_compared(tmp_path: Path) -> None:
    """No output of the step shows how the next state decides near 0, and few steps come near."""
    program = to_step_form(compiled(_HIDDEN_STATE))
    write_c(program, {}, tmp_path, COptions())
    source = tmp_path / "src" / "test.c"
    right = source.read_text(encoding="ascii")
    wrong = right.replace("> 0.0f) ? ", "> 0.001f) ? ")
    assert wrong != right
    assert "agree" in program_said(tmp_path)
    source.write_text(wrong, encoding="ascii")
    assert "leaves another state" in program_said(tmp_path)


def test_parameters_of_their_own_are_in_the_vectors_of_the_test_program(tmp_path: Path) -> None:
    program, _ = _made(_TWO_ROOTS)
    write_c(program, {}, tmp_path, COptions(extras=("jacobian",)))
    (text,) = (p.read_text(encoding="ascii") for p in tmp_path.glob("test/*_vectors.h"))
    assert re.search(r"golden_place\[\d+\]", text)
    inline = tmp_path / "inline"
    write_c(program, {}, inline, COptions(extras=("jacobian",), params="inline"))
    (text,) = (p.read_text(encoding="ascii") for p in inline.glob("test/*_vectors.h"))
    assert "golden_place" not in text
    assert "_start_of" in text


def test_runs_made_together_are_those_made_one_by_one() -> None:
    program, interface = _made(_TWO_RANGES)
    begun = [GoldenRun(3), GoldenRun(4, "above"), GoldenRun(5, None, 2), GoldenRun(6, "nan", 1, 0)]
    weights = physical_weights(program, {})
    together = golden_runs(program, interface, weights, 6, begun)
    for run, alone in zip(together, begun, strict=True):
        (expected,) = golden_runs(program, interface, weights, 6, [alone])
        assert np.array_equal(run.status, expected.status)
        for one, other in ((run.outputs, expected.outputs), (run.states, expected.states)):
            assert all(np.array_equal(one[n], other[n], equal_nan=True) for n in other)
        slopes = expected.slopes.items()
        assert all(np.array_equal(run.slopes[n], m, equal_nan=True) for n, m in slopes)


def test_runs_are_told_one_after_the_other() -> None:
    program, interface = _made(_TWO_RANGES)
    begun = [GoldenRun(3), GoldenRun(4, "above"), GoldenRun(5, None, 2)]
    runs = golden_runs(program, interface, physical_weights(program, {}), 6, begun)
    told = [expected_text(interface, [run]) for run in runs]
    assert [text.count("\n") for text in told] == [6] * 3
    assert expected_text(interface, runs) == "\n".join(told)


def test_gaps_of_some_decisions_are_their_columns() -> None:
    program, interface = _made(_SEVERAL)
    weights = physical_weights(program, {})
    (run,) = golden_runs(program, interface, weights, 1, [GoldenRun(0, StartPoint())])
    steps = TrialSteps(program, interface, weights, [run.start])
    decisions, drawn = Decisions(program, interface), drawn_trials(steps, np.random.default_rng(0))
    values, every = steps.run(drawn), decisions.every
    gaps = decisions.gaps(values, len(drawn), every)
    v = np.abs(steps.inputs(drawn)["v"].astype(np.float64))
    p = values.next_states["p"].astype(np.float64)[:, np.newaxis]
    beyond = np.abs(p - [-3.0, 4.0])
    # the slopes of |v| ask for the sign of v again
    assert np.array_equal(gaps[:, [0, 1, 2]], v)
    assert np.array_equal(gaps[:, [-2, -1]], np.where(np.isnan(beyond), np.inf, beyond))
    assert np.array_equal(gaps == 0.0, decisions.signs(values, len(drawn)) == 0)
    for some in (every[::2], every[::-1], every[1:2]):
        found = decisions.gaps(steps.run(drawn), len(drawn), some)
        assert np.array_equal(found, gaps[:, some])


def test_a_step_that_decides_nothing_has_golden_runs_all_the_same(tmp_path: Path) -> None:
    program, _ = _made("inputs: {u: {}}\noutputs: {y: {expr: 2 * u}}\n")
    write_c(program, {}, tmp_path, COptions())
    (text,) = (p.read_text(encoding="ascii") for p in tmp_path.glob("test/*_vectors.h"))
    assert "_begin_differs" in text


@pytest.mark.parametrize("params", ["const", "tunable"])
def test_other_parameters_keep_their_bounds(params: ParameterAccess, tmp_path: Path) -> None:
    """Learned knots rise in every golden step: C finds its piece by their order."""
    program = compiled(_LEARNED_KNOTS)
    write_c(program, {}, tmp_path, COptions(params=params))
    assert "agree" in program_said(tmp_path)
