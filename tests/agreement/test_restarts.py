"""Exports for devices take states with `on_range: reset` back; the judge does so beside them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from msnn.agreement.judgement import drawn_record
from msnn.exports.check import check_export
from msnn.exports.export import plan_exports, write_export
from msnn.model.load import load_model
from spec_schema.diagnostics.diagnostic import Findings
from tests.conditions import require_tool

SPEC = """msnn: 1
name: tanks
sample_time: 10 ms
dims: {tank: 2}
inputs: {u: {dims: tank, range: [-5, 5], on_invalid: clamp}}
parameters: {first: {init: [0.1, 0.2], dims: tank}}
states:
  x: {dims: tank, next: x + u, init: first, range: [-30, 30], on_range: reset}
  z: {next: "0.9 * z + sum(x)", init: 0, range: [-90, 90], on_range: reset}
outputs: {y: "x + z"}
export: {c: {dtype: TYPE}, torch: {}, fmu: {dtype: TYPE}}
"""


@pytest.mark.parametrize("target", ["c", "fmu", "torch"])
@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_states_that_begin_again_are_no_difference(target: str, dtype: str, tmp_path: Path) -> None:
    """C that did what the spec asks was told to differ, and to be reported."""
    require_tool("gcc", install="apt install gcc")
    path = tmp_path / "tanks.msnn.yaml"
    path.write_text(SPEC.replace("TYPE", dtype))
    (plan,) = plan_exports(load_model(path), [target], Findings())
    record = drawn_record(plan.program, "drawn")
    written = write_export(plan, {}, tmp_path / target)
    found = check_export(plan, {}, written, record)
    assert found.agrees, found.faults
    # held to the other meaning it differs: along the record the states do leave their ranges
    other = replace(plan.target, is_deployed=not plan.target.is_deployed)
    assert not check_export(replace(plan, target=other), {}, written, record).agrees
