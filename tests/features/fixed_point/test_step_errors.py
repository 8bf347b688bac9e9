"""The proved bound of a step holds in every step, and a rule that is broken is seen."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any

import pytest

from compiler.ir.program import Program
from msnn.features.fixed_point.compile.compile_integers import integer_program
from msnn.features.fixed_point.compile.settle import Settler
from msnn.features.fixed_point.compile.tables import furthest
from msnn.features.fixed_point.deviation import LOST
from msnn.features.fixed_point.integers.builder import IntegerBuilder
from msnn.features.fixed_point.integers.program import Q15, Q31, IntegerProgram, Width
from tests.features.fixed_point.exported import fixed_model, gallery_text, initial_weights, planned
from tests.features.fixed_point.random_specs import random_spec
from tests.features.fixed_point.step_runs import step_errors

GALLERY = ("reference", "battery", "heater", "engine_map", "quarter_car", "motor")


def _made(folder: Path, text: str, width: Width) -> tuple[Program, IntegerProgram]:
    program = planned(fixed_model(folder, text, width.name)).program
    return program, integer_program(program, initial_weights(program), width)


def exceeded(
    program: Program, integers: IntegerProgram, runs: int, steps: int
) -> dict[str, tuple[float, float]]:
    """Outputs and states of which a step was further off than is proved: error and bound."""
    weights = initial_weights(program)
    seen = step_errors(program, weights, integers, runs, steps)
    ends = {port.name: (port.low, port.high, port.fraction) for port, _ in integers.outputs}
    ends |= {m.name: (m.low, m.high, m.fraction) for m in integers.memories}
    found: dict[str, tuple[float, float]] = {}
    for bound in integers.step_errors:
        low, high, fraction = ends[bound.name]
        room = LOST * math.ldexp(max(-low, high), -fraction)
        error = seen[bound.name, bound.is_state]
        if error > bound.largest + room:
            found[bound.name] = error, bound.largest
    return found


@pytest.mark.parametrize("width", [Q15, Q31], ids=lambda width: width.name)
@pytest.mark.parametrize("name", GALLERY)
def test_no_step_of_the_gallery_is_further_off_than_is_proved(
    name: str, width: Width, tmp_path: Path
) -> None:
    program, integers = _made(tmp_path, gallery_text(name), width)
    assert not exceeded(program, integers, 100, 60)


@pytest.mark.parametrize("seed", range(12))
def test_no_step_of_a_random_model_is_further_off_than_is_proved(seed: int, tmp_path: Path) -> None:
    program, integers = _made(tmp_path, random_spec(seed), Q15)
    assert not exceeded(program, integers, 60, 40)


BEYOND = """msnn: 1
name: beyond
sample_time: 10 ms
inputs: {v: {range: [-1, 1]}}
outputs: {positive: "max(v / 3 - 2, 0) + v", negative: "min(v / 3 + 2, 0) + v"}
"""


def test_a_limit_that_no_value_reaches_stays_within_what_is_proved(tmp_path: Path) -> None:
    program, integers = _made(tmp_path, BEYOND, Q15)
    assert not exceeded(program, integers, 20, 10)


def _no_rounding(patch: pytest.MonkeyPatch) -> None:
    plain = IntegerBuilder.to_fraction

    def exact(self: IntegerBuilder, node: int, fraction: int) -> int:
        made = plain(self, node, fraction)
        self.errors[made] = self.errors[node]
        return made

    patch.setattr(IntegerBuilder, "to_fraction", exact)


def _exact_coefficients(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(Settler, "_term_error", lambda *_: 0.0)


def _exact_tables(patch: pytest.MonkeyPatch) -> None:
    from msnn.features.fixed_point.compile import elementwise

    plain = elementwise.fitted_table

    def exact(*arguments: Any) -> Any:
        made = plain(*arguments)
        return dataclasses.replace(made, error=0.0)

    patch.setattr(elementwise, "fitted_table", exact)


def _sure_decisions(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(IntegerBuilder, "is_doubtful", lambda *_: False)


def _flat_functions(patch: pytest.MonkeyPatch) -> None:
    from msnn.features.fixed_point.compile import elementwise

    patch.setattr(elementwise, "furthest", lambda *_: 0.0)


STEEP = """\
msnn: 1
name: steep
sample_time: 0.1 s
inputs: {u: {range: [-1, 1]}, v: {range: [0.0999, 0.1001]}}
outputs:
  chosen: {expr: "where(v >= 0.1, 1, -1)"}
  steep: {expr: "exp(6 * tanh(u))"}
  table: {expr: "tanh(3 * u)"}
"""


@pytest.mark.parametrize(
    ("broken", "text"),
    [
        (_no_rounding, gallery_text("quarter_car")),
        (_exact_coefficients, gallery_text("heater")),
        (_exact_tables, STEEP),
        (_sure_decisions, STEEP),
        (_flat_functions, STEEP),
    ],
)
def test_a_rule_that_leaves_an_error_out_is_seen(
    broken: Any, text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program, integers = _made(tmp_path, text, Q15)
    assert not exceeded(program, integers, 300, 40)
    broken(monkeypatch)
    program, integers = _made(tmp_path, text, Q15)
    assert exceeded(program, integers, 300, 40)


def test_what_cannot_be_proved_has_no_bound() -> None:
    assert furthest("cbrt", 0.0, 1.0, 1e-3) == math.inf
    assert furthest("log", 0.0, 1.0, 1e-3) == math.inf
    assert furthest("log", 0.0, 1.0, 0.0) == 0.0


def test_an_argument_beyond_its_bounds_meets_steeper_slopes() -> None:
    """x is in 0 … 1, and the real value that it stands for up to 1.5."""
    assert furthest("exp", 0.0, 1.0, 0.5) >= math.exp(1.5) - math.exp(1.0)
    assert furthest("1/x", 1.0, 2.0, 0.5) >= 1 / 0.5 - 1.0


def test_the_error_of_a_product_counts_both_errors_together() -> None:
    """Of words that are 1 each may stand for 1.5: a product that is 1 then stands for 2.25."""
    builder = IntegerBuilder(Q15)
    words = [builder.word("u", index, 0, -1, 1) for index in range(2)]
    for word in words:
        builder.allow(word, 0.5)
    assert builder.errors[builder.product(*words)] == 1.25
