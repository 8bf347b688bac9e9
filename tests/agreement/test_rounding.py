"""What rounding costs a model is told and not called a difference; what differs is found still."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import msnn
from msnn.agreement.agreement import Agreement
from msnn.agreement.judgement import FloatType, agreement_record
from msnn.agreement.report import AgreementReport, agreement_diagnostics
from msnn.exports.export import plan_exports
from msnn.model.weights.weights_file import initial_weights
from spec_schema.diagnostics.diagnostic import Findings
from tests.agreement.exported import checked as checked_export
from tests.conditions import require_tool

SPEC = """
msnn: 1
name: pid
sample_time: 10 ms
inputs: {r: m, y: m}
parameters: {kp: 2.0, ki: {init: 0.5, unit: 1/s}, kd: {init: 0.1, unit: s}}
equations: {e: r - y}
outputs:
  u: {expr: kp*e + ki*integral(e) + kd*der(e)}
  rate: {expr: der(e)}
data: {source: {train: a.csv}}
"""

TYPES: list[tuple[str, FloatType]] = [
    ("c", "float32"),
    ("c", "float64"),
    ("torch", "float32"),
    ("torch", "float64"),
    ("onnx", "float32"),
    ("onnx", "float64"),
    ("casadi", "float64"),
]


def controller(folder: Path) -> msnn.Model:
    """A controller whose error of 1e-3 is the difference of signals of size 1, every 10 ms."""
    time = np.arange(1000) * 0.01
    setpoint = 1 + 0.5 * np.sin(time)
    table = np.c_[setpoint, setpoint - 1e-3 * np.sin(3 * time)]
    np.savetxt(folder / "a.csv", table, delimiter=",", header="r,y", comments="")
    (folder / "pid.yaml").write_text(SPEC)
    return msnn.load(folder / "pid.yaml")


def checked(folder: Path, target: str, dtype: FloatType, factor: float = 1.0) -> Agreement:
    model = controller(folder)
    findings = Findings()
    (plan,) = plan_exports(model, [target], findings)
    plan = replace(plan, dtype=dtype)
    weights = initial_weights(plan.program)
    written = {name: value * factor for name, value in weights.items()}
    record = agreement_record(model, plan.program, folder)
    return checked_export(plan, weights, folder / "out", record, written=written)


@pytest.mark.parametrize(("target", "dtype"), TYPES)
def test_a_controller_along_small_errors_agrees(
    target: str, dtype: FloatType, tmp_path: Path
) -> None:
    require_tool("gcc", install="apt install gcc")
    found = checked(tmp_path, target, dtype)
    assert found.agrees, found
    warned = agreement_diagnostics(AgreementReport("", (found,), ()))
    if dtype == "float64":
        assert not warned
        return
    assert [warning.code for warning in warned] == ["W1058", "W1058"]
    assert "`rate`" in warned[1].message
    assert "dtype: float64" in (warned[1].help or "")


@pytest.mark.parametrize(("target", "dtype"), TYPES)
def test_other_weights_differ_there_too(target: str, dtype: FloatType, tmp_path: Path) -> None:
    require_tool("gcc", install="apt install gcc")
    # C in float32 promises bits; the others what rounding cannot explain, here 16 x 1e-3 of u
    factor = 1 + (1e-6 if (target, dtype) == ("c", "float32") or dtype == "float64" else 0.05)
    found = checked(tmp_path, target, dtype, factor)
    assert not found.agrees
    (first, *_) = agreement_diagnostics(AgreementReport("", (found,), ()))
    assert first.code == "E1057"
    assert f"{target} differs from the interpreter in `u`" in first.message
