"""How far fixed point is from float64, and that the export says so."""

import json
import re
from pathlib import Path

import pytest

from msnn.exports.export import write_export
from tests.fixed_point.exported import fixed_model, gallery_text, planned

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
