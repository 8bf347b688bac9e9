"""How far fixed point is from float64, and that the export says so."""

import json
import re
from pathlib import Path

import pytest

from msnn.exports.export import write_export
from msnn.features.fixed_point.compile.compile_integers import integer_program
from msnn.features.fixed_point.integers.program import Q15, Q31
from tests.features.fixed_point.exported import fixed_model, gallery_text, initial_weights, planned

# the share of the range that 16 bits, tables of 2^-10 and rounded coefficients add up to over a
# million steps: what was seen, rounded up
LARGEST = {
    "reference": {"v_next": 3e-4},
    "battery": {"voltage_now": 2e-4, "charge_next": 1e-4},
    "heater": {"oven_next": 5e-4, "asked": 6e-3, "ageing_now": 2e-3},
    "engine_map": {"torque_now": 3e-4, "shown_speed": 1e-4},
    "quarter_car": {"z_next": 4e-3, "comfort": 8e-2},
}


def _errors(name: str, dtype: str, folder: Path) -> dict[str, float]:
    plan = planned(fixed_model(folder, gallery_text(name), dtype))
    write_export(plan, {}, folder / "c")
    about = json.loads((folder / "c" / f"{plan.prefix}.json").read_text(encoding="utf-8"))
    return {row["output"]: row["largest"] / row["range"] for row in about["errors"]}


@pytest.mark.parametrize("name", LARGEST)
def test_q15_is_within_its_error(name: str, tmp_path: Path) -> None:
    found = _errors(name, "q15", tmp_path)
    assert found.keys() == LARGEST[name].keys()
    for output, error in found.items():
        assert error < LARGEST[name][output], output


@pytest.mark.parametrize("name", LARGEST)
def test_q31_is_a_hundred_times_closer(name: str, tmp_path: Path) -> None:
    for output, error in _errors(name, "q31", tmp_path).items():
        assert error < max(LARGEST[name][output] / 100, 1e-6), output


LIMITED = """msnn: 1
name: limited
sample_time: 10 ms
inputs: {v: {range: [-1, 1]}}
outputs:
  positive: {expr: "max(v - 2, 0) + 0.5 * v"}
  negative: {expr: "min(v + 2, 0) + 0.5 * v"}
  held: {expr: "clip(v, 3, 5) + 0.5 * v"}
  kept: {expr: "clip(v, -3, 5) + 0.5 * v"}
"""


@pytest.mark.parametrize(("dtype", "largest"), [("q15", 1e-3), ("q31", 1e-7)])
def test_a_limit_that_no_value_reaches_keeps_its_number(
    dtype: str, largest: float, tmp_path: Path
) -> None:
    plan = planned(fixed_model(tmp_path, LIMITED, dtype))
    write_export(plan, {}, tmp_path / "c")
    about = json.loads((tmp_path / "c" / "limited.json").read_text(encoding="utf-8"))
    errors = {row["output"]: row["largest"] for row in about["errors"]}
    assert errors.keys() == {"positive", "negative", "held", "kept"}
    assert max(errors.values()) < largest, errors


EXACT = """\
msnn: 1
name: exact
inputs: {u: {range: [-4, 4]}}
outputs: {y: 0.5 * u}
"""


def test_the_export_shows_its_error(tmp_path: Path) -> None:
    plan = planned(fixed_model(tmp_path, gallery_text("reference"), "q15"))
    write_export(plan, {}, tmp_path / "c")
    table = plan.target.tell(plan, tmp_path / "c")
    assert table.startswith("Error of q15 against float64, seen over ")
    assert "v_next" in table
    assert re.search(r"\nv_next +output +0\.0012\nv +state +0\.00023", table), table
    readme = (tmp_path / "c" / "README.md").read_text(encoding="utf-8")
    assert "largest / range" in readme
    assert "| input | `u` | 10 | -20480 | 20480 |" in readme


def test_a_step_that_adds_no_error_says_so(tmp_path: Path) -> None:
    plan = planned(fixed_model(tmp_path, EXACT, "q15"))
    write_export(plan, {}, tmp_path / "c")
    assert plan.target.tell(plan, tmp_path / "c").endswith("adds at most, proved:\nnothing")


def test_without_a_compiler_fewer_steps_are_run_and_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CC", "no-such-compiler")
    plan = planned(fixed_model(tmp_path, gallery_text("reference"), "q15"))
    write_export(plan, {}, tmp_path / "c")
    table = plan.target.tell(plan, tmp_path / "c")
    assert table.startswith("Error of q15 against float64, seen over 10,000 steps:")


@pytest.mark.parametrize("dtype", ["q15", "q31"])
@pytest.mark.parametrize(
    "formula", ["where(u <= 0.5, 1, -1)", "where(u <= 0.5, 1.3, 0.3)", "sign(u) + 0.001"]
)
def test_a_choice_between_numbers_has_the_bits_of_a_word(
    formula: str, dtype: str, tmp_path: Path
) -> None:
    """Its scale was that of 0 or 1, at which the number added to it was rounded away."""
    text = f"""msnn: 1
name: m
sample_time: 10 ms
inputs: {{u: {{range: [-1, 1]}}}}
outputs: {{y: "{formula}"}}
"""
    program = planned(fixed_model(tmp_path, text, dtype)).program
    width = Q15 if dtype == "q15" else Q31
    integers = integer_program(program, initial_weights(program), width)
    (error,) = integers.step_errors
    assert error.largest < 2.0 ** (2 - width.word)
