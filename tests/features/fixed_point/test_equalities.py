"""Golden steps meet the thresholds of comparisons exactly: `<` is not taken for `<=` unseen."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

from compiler.ir.ops import Relation
from msnn.agreement.agreement import BeyondProof
from msnn.exports.export import write_export
from msnn.features.fixed_point.compile.compile_integers import integer_program
from msnn.features.fixed_point.compile.elementwise import ElementwiseForms
from msnn.features.fixed_point.compile.polynomials import PolynomialForm
from msnn.features.fixed_point.compile.thresholds import Decided, IntegerCondition
from msnn.features.fixed_point.golden.equalities import golden_equalities
from msnn.features.fixed_point.integers.program import Q15, Q31
from tests.agreement.exported import checked
from tests.conditions import require_tool
from tests.features.fixed_point.exported import (
    fixed_model,
    gallery_text,
    initial_weights,
    planned,
    run_test_program,
)

SPEC = """\
msnn: 1
name: m
sample_time: 0.1 s
inputs: {u: {range: [-1, 1]}, w: {range: [-1, 1]}}
states:
  x: {next: "0.5 * x + u", range: [-2, 2], init: "where(w.meas[t-1] > 0.5, 1, 0.25)"}
equations:
  doubled: {expr: 2 * u, range: [-1, 1]}
outputs:
  at_most: {expr: "where(u <= 0.5, 1, -1)"}
  below: {expr: "where(u < w, u, -1)"}
  at_least: {expr: "where(w >= 0.25, u, 1)"}
  together: {expr: "where(u + w >= 0.25, w, 1)"}
  above: {expr: "where(x > 0.5, u, 2)"}
  limited: {expr: doubled}
"""
OTHER = {"<": "<=", "<=": "<", ">": ">=", ">=": ">"}


def _comparisons(code: str) -> list[re.Match[str]]:
    """Those of `reset` and `step` but of loops, and of min and max, which are the same at ties."""
    begin = code.index("m_status_t m_reset(")
    extremes = [one.span() for one in re.finditer(r"\((\S+) [<>] (.+)\) \? \1 : \2;", code)]
    loops = [one.span() for one in re.finditer(r"for \(.*", code)]
    return [
        one
        for one in re.finditer(r" (<=?|>=?) ", code)
        if one.start() > begin
        and not any(first <= one.start() < last for first, last in (*extremes, *loops))
    ]


@pytest.mark.parametrize("dtype", ["q15", "q31"])
def test_c_that_decides_otherwise_at_equality_differs(dtype: str, tmp_path: Path) -> None:
    require_tool("gcc", "apt-get install gcc")
    write_export(planned(fixed_model(tmp_path, SPEC, dtype)), {}, tmp_path / "c")
    source = tmp_path / "c" / "src" / "m.c"
    code = source.read_text()
    found = _comparisons(code)
    assert len(found) == 8  # six of `where`, two ends of the range
    assert "agree" in run_test_program(tmp_path / "c", "m", "gcc", ("-O0",))
    for one in found:
        source.write_text(f"{code[: one.start()]} {OTHER[one[1]]} {code[one.end() :]}")
        with pytest.raises(subprocess.CalledProcessError):
            run_test_program(tmp_path / "c", "m", "gcc", ("-O0",))


@pytest.mark.parametrize("relation", [*Relation])
def test_a_lowering_that_decides_otherwise_at_equality_is_found_by_check(
    relation: Relation, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The C has the bits of its judge: what is proved of a step says that both are wrong.

    It says so where both sides are exact; a sum in float64 may fall on either side.
    """
    require_tool("gcc", "apt-get install gcc")
    plain = ElementwiseForms.condition

    def condition(
        self: ElementwiseForms, which: Relation, left: PolynomialForm, right: PolynomialForm
    ) -> IntegerCondition | Decided:
        other = Relation(OTHER[which.value]) if which is relation else which
        return plain(self, other, left, right)

    plan = planned(fixed_model(tmp_path, SPEC, "q15"))
    assert checked(plan, {}, tmp_path / "right").agrees
    monkeypatch.setattr(ElementwiseForms, "condition", condition)
    found = checked(plan, {}, tmp_path / "wrong")
    assert found.bits == 0
    (fault, *_) = found.faults
    assert isinstance(fault, BeyondProof)
    assert "a step beside the record, with equal sides of a comparison" in fault.difference


@pytest.mark.parametrize("width", [Q15, Q31], ids=lambda width: width.name)
@pytest.mark.parametrize("name", ["battery", "heater", "quarter_car"])
def test_the_same_program_gives_the_same_runs(name: str, width: object, tmp_path: Path) -> None:
    assert width in (Q15, Q31)
    program = planned(fixed_model(tmp_path, gallery_text(name), "q15")).program
    integers = integer_program(program, initial_weights(program), Q15 if width is Q15 else Q31)
    assert golden_equalities(integers, 5, 2) == golden_equalities(integers, 5, 2)
