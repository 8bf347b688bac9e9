"""A condition that rounding decides is counted, and its value must be one of the choices."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

import msnn
from msnn.agreement.agreement import Agreement, FarStep, NoChoice
from msnn.agreement.judgement import FloatType, agreement_record
from msnn.agreement.report import AgreementReport, agreement_diagnostics, agreement_table
from msnn.exports.check import check_export
from msnn.exports.export import plan_exports, write_export
from spec_schema.diagnostics.diagnostic import Findings
from tests.conditions import require_tool

TYPES: list[tuple[str, FloatType]] = [
    ("c", "float64"),
    ("torch", "float32"),
    ("torch", "float64"),
    ("onnx", "float32"),
    ("onnx", "float64"),
    ("casadi", "float64"),
]
ZERO = "(0.1 * u + 0.2 * u - 0.3 * u)"
"""Nothing but rounding, of numbers that are no sums of powers of 2."""


def _model(folder: Path, outputs: str, states: str = "") -> msnn.Model:
    text = "msnn: 1\nname: m\nsample_time: 0.1 s\ninputs: {u: {range: [-1, 1]}}\n"
    path = folder / "m.msnn.yaml"
    path.write_text(f"{text}{states}outputs: {{{outputs}}}\n")
    return msnn.load(path)


def _compared(
    folder: Path, means: str, does: str, target: str, dtype: FloatType, states: str = ""
) -> Agreement:
    """What is said of an export that does something else than its spec means."""
    require_tool("gcc", install="apt install gcc")
    model = _model(folder, means, states)
    (plan,) = plan_exports(model, [target], Findings())
    (other,) = plan_exports(_model(folder, does, states), [target], Findings())
    written = write_export(replace(other, dtype=dtype), {}, folder / "out")
    record = agreement_record(model, plan.program, folder)
    return check_export(replace(plan, dtype=dtype), {}, written, record)


def _table(found: Agreement) -> list[str]:
    return agreement_table(AgreementReport("drawn numbers", (found,), ())).splitlines()[1:]


@pytest.mark.parametrize(("target", "dtype"), TYPES)
def test_a_condition_that_is_never_decided_compares_nothing(
    target: str, dtype: FloatType, tmp_path: Path
) -> None:
    means, does = (f'y: "where({ZERO} {than} 0, 1, 2)", z: u' for than in ("<", ">="))
    found = _compared(tmp_path, means, does, target, dtype)
    assert found.agrees, found.faults
    assert found.undecided == {"`y`": found.steps}
    header, row = _table(found)
    assert "undecided" in header
    assert row.split()[:4] == [target, dtype, str(found.steps), str(found.steps)]
    assert row.endswith("agrees, nothing compared of `y`")


@pytest.mark.parametrize(("target", "dtype"), TYPES)
def test_what_is_none_of_the_choices_differs(target: str, dtype: FloatType, tmp_path: Path) -> None:
    means, does = (f'y: "where({ZERO} < 0, 1, {other})"' for other in ("2", "2.5"))
    found = _compared(tmp_path, means, does, target, dtype)
    (fault,) = found.faults
    assert isinstance(fault, NoChoice)
    assert (fault.of, fault.error) == ("`y`", 0.5)
    (said,) = agreement_diagnostics(AgreementReport("", (found,), ()))
    assert f"step {fault.step}, at which rounding decides a condition, is off by 0.5" in (
        said.message
    )


@pytest.mark.parametrize(("target", "dtype"), TYPES)
def test_a_wrong_branch_at_decided_steps_is_found_beside_undecided_ones(
    target: str, dtype: FloatType, tmp_path: Path
) -> None:
    mixed = f"where(u > 0.5, u, {ZERO})"
    means, does = (f'y: "where({mixed} {than} 0, 1, 2)"' for than in (">", "<"))
    found = _compared(tmp_path, means, does, target, dtype)
    assert 0 < found.undecided["`y`"] < found.steps
    assert not found.untried
    assert [type(fault) for fault in found.faults] == [FarStep]


def test_choices_that_are_the_same_beside_the_threshold_are_compared(tmp_path: Path) -> None:
    kink = f'y: "where({ZERO} > 0, {ZERO}, 0) + u"'
    found = _compared(tmp_path, kink, kink, "torch", "float64")
    assert found.agrees
    assert not found.undecided
    assert "undecided" not in _table(found)[0]


def test_conditions_that_depend_on_each_other_are_tried_in_every_way(tmp_path: Path) -> None:
    """Both the sign and what depends on it are open; 1.5 is none of what they can give."""
    inner = f"where({ZERO} > 0, 0.25, {ZERO})"
    means = f'y: "where({inner} > 0, sign({ZERO}), 10) + {inner}"'
    same = _compared(tmp_path, means, means, "casadi", "float64")
    assert same.agrees, same.faults
    other = f'y: "where({inner} >= 0, sign({ZERO}), 10) + {inner}"'
    assert _compared(tmp_path, means, other, "casadi", "float64").agrees
    none = _compared(tmp_path, means, 'y: "1.5 + 0 * u"', "casadi", "float64")
    assert [type(fault) for fault in none.faults] == [NoChoice]


def test_first_states_and_next_states_are_judged_so_too(tmp_path: Path) -> None:
    zero = ZERO.replace("u", "u.meas[t-1]")
    states = (
        f'states: {{x: {{next: "0.5 * x + where({ZERO} > 0, 1, 2)", '
        f'init: "where({zero} > 0, 1, 2)"}}}}\n'
    )
    found = _compared(tmp_path, "y: x", "y: x", "casadi", "float64", states)
    assert found.agrees, found.faults
    assert {"the state `x`": found.steps, "the first state `x`": 1}.items() <= (
        found.undecided.items()
    )


def test_more_open_conditions_than_can_be_tried_are_counted(tmp_path: Path) -> None:
    many = " + ".join(f"where({ZERO} > {k}e-300, {2**k}, 0)" for k in range(8))
    found = _compared(tmp_path, f'y: "{many}"', f'y: "{many}"', "casadi", "float64")
    assert found.agrees
    assert found.untried == ("`y`",)


@pytest.mark.parametrize("target", ["torch", "onnx"])
def test_what_single_precision_decides_otherwise_excuses_no_other_step(
    target: str, tmp_path: Path
) -> None:
    mixed = f"where(where(u > 0.5, u, {ZERO}) > 0, 100, 0)"
    means, does = (f'y: "{mixed} + {factor} * u"' for factor in ("1", "1.01"))
    found = _compared(tmp_path, means, does, target, "float32")
    assert not found.agrees
