"""Kinks of what goes to solvers: warned of by line, accepted, or rounded off."""

from __future__ import annotations

from pathlib import Path

import pytest

from compiler.hessian.step_derivatives import step_derivatives
from msnn.exports.export import plan_exports
from msnn.model.load import load_model
from msnn.model.weights.weights_file import initial_weights
from spec_schema.diagnostics.diagnostic import Diagnostic, Findings
from tests.agreement.exported import checked

DRAG = """
msnn: 1
name: drag
sample_time: 0.1 s
inputs: {force: {range: [-5, 5]}, load: {}}
states: {v: {range: [-10, 10], next: "0.9 * v + 0.1 * force - 0.01 * v * abs(v)", init: 0}}
equations:
  held: clip(v, -3, 3)
  far: clip(v, -20, 20)
  open: abs(load)
outputs: {speed: "held + far + where(force > 1, open, force)"}
"""


def said(text: str, folder: Path) -> list[Diagnostic]:
    path = folder / "drag.msnn.yaml"
    path.write_text(text)
    findings = Findings()
    plan_exports(load_model(path), ["casadi"], findings)
    return [one for one in findings.in_order if one.code == "W0955"]


def test_every_line_with_a_kink_that_ranges_reach_is_named_once(tmp_path: Path) -> None:
    """Not that of `far`, which is beyond, nor of `open`, of whose range nothing is known."""
    found = said(DRAG + "export: {casadi: {}}\n", tmp_path)
    assert [one.span and one.span.line for one in found] == [6, 8, 11]
    assert ["abs" in one.message for one in found] == [True, False, False]
    assert "`force` in [-5, 5]" in found[2].notes[0]


SHARP = """
msnn: 1
name: valve
sample_time: 10 ms
inputs: {om: {range: [-5, 5]}}
equations:
  a: abs(om)
  b: sqrt(a)
  c: sign(om)
  d: where(om > 0, 2 * om, om)
  e: max(om, 1)
outputs: {y: a + b + c + d + e}
export: {casadi: {}}
"""


def test_what_happens_at_a_kink_is_said_as_it_is(tmp_path: Path) -> None:
    assert [one.message for one in said(SHARP, tmp_path)] == [
        "the slope of `abs` jumps inside the declared ranges",
        "the slope of `sqrt` is infinite, as its argument can be 0, inside the declared ranges",
        "`sign` jumps inside the declared ranges",
        "`where` can jump, or its slope, inside the declared ranges",
        "the slope of `max` jumps inside the declared ranges",
    ]


@pytest.mark.parametrize("entry", ["export: {casadi: {smooth: false}}\n", ""])
def test_nothing_is_said_where_kinks_are_accepted_or_casadi_is_not_asked_for(
    entry: str, tmp_path: Path
) -> None:
    assert not said(DRAG + entry, tmp_path)


def test_what_cannot_be_rounded_off_is_named(tmp_path: Path) -> None:
    logarithm = DRAG.replace("where(force > 1, open, force)", "where(force > 1, log(force), 0)")
    (found,) = said(logarithm + "export: {casadi: {smooth: true}}\n", tmp_path)
    assert found.span is not None
    assert found.span.line == 11
    assert "leaves a kink of `where`" in found.message
    assert not said(DRAG + "export: {casadi: {smooth: true}}\n", tmp_path)


def test_a_smooth_export_agrees_with_its_smooth_judge(tmp_path: Path) -> None:
    path = tmp_path / "drag.msnn.yaml"
    path.write_text(DRAG + "export: {casadi: {smooth: true}}\n")
    (plan,) = plan_exports(load_model(path), ["casadi"], Findings())
    found = checked(plan, initial_weights(plan.program), tmp_path / "out")
    assert found.agrees, found
    matrix = step_derivatives(plan.program).hessian
    assert matrix is not None
    assert None in matrix.known  # v·|v| bends everywhere now
