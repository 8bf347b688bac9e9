"""Names of the spec keep their identifiers in generated C; those that are made up give way."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest

from backends.c import COptions
from compiler.ir.program import Program
from msnn.exports.export import plan_exports
from msnn.model.load import load_model
from spec_schema.diagnostics.diagnostic import Findings
from tests.backends.c.c_programs import built, write_library
from tests.conditions import require_tool

TAKEN = """\
msnn: 1
name: m
sample_time: 0.1 s
integrator: {rk4: {substeps: 2}}
inputs: {u: {}}
states:
  z: {der: "u - z_1 * tanh(z)", init: 0}
equations:
  z_1: sin(z) * cos(z) * 3 + z
  z_1_2: z_1 * u + tanh(u) * 3 - 1
  z_for_k2: "z_1 * u - 3"
  z_der_part: "z_1 * z_for_k2 + 4 * u * u"
  part: "z_der_part * u - z_1_2 * z_for_k2 * z_1_2"
  z_next: "part * part * z_der_part"
outputs:
  y: {expr: "part * z_next + z_for_k2 * z_next"}
"""

PARTS = """\
msnn: 1
name: m
sample_time: 0.1 s
inputs: {u: {}, v: {}, w: {}}
equations: {a: sin(u) * cos(v) * tanh(w) * u * v * w * u - 1, \
b: cos(u) * tanh(v) * sin(w) * v * v * w * u * w * w - 2}
outputs: {y: a * b * a + b, z: tanh(a) - b * a}
"""


def _program(text: str, folder: Path) -> Program:
    path = folder / "m.msnn.yaml"
    path.write_text(text)
    (plan,) = plan_exports(load_model(path), ["c"], Findings())
    return plan.program


def _step(program: Program, folder: Path) -> list[str]:
    write_library(program, folder, COptions())
    code = (folder / "src" / "m.c").read_text()
    return code[code.index("m_status_t m_step(") :].splitlines()


def _declared(lines: list[str]) -> dict[str, str]:
    """The comment before each local constant, by the local's name."""
    found: dict[str, str] = {}
    comment = ""
    for line in lines:
        if "/* spec: " in line:
            comment = line
        declared = re.match(r" *const m_real (\w+) = ", line)
        if declared:
            found[declared[1]] = comment
    return found


@pytest.fixture(scope="module")
def taken(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """What the step of `TAKEN` declares."""
    folder = tmp_path_factory.mktemp("taken")
    return _declared(_step(_program(TAKEN, folder), folder / "c"))


@pytest.mark.parametrize("name", ["z_1", "z_1_2", "z_for_k2", "z_der_part", "part", "z_next"])
def test_an_equation_keeps_its_name_beside_what_an_integrator_names(
    name: str, taken: dict[str, str]
) -> None:
    assert re.search(rf"/\* spec: {name}( \[1\])? = ", taken[name])


def test_such_code_computes_what_it_did(tmp_path: Path) -> None:
    require_tool("gcc", install="apt install gcc")
    step = built(_program(TAKEN, tmp_path), tmp_path / "c", COptions())
    assert step.selftest() == 0


def test_equations_on_one_line_name_their_own_parts_without_formulas(tmp_path: Path) -> None:
    program = replace(_program(PARTS, tmp_path), formulas=())
    lines = [line for line in _step(program, tmp_path / "c") if "_part" in line]
    assert [line for line in lines if "const m_real a_part =" in line and "m_sin(u->u)" in line]
    assert [line for line in lines if "const m_real b_part =" in line and "m_cos(u->u)" in line]
