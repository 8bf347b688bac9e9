"""The comparison of exports with the judge finds what it is there to find."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from backends.c import COptions
from compiler.passes.simplify import prune_outputs
from compiler.passes.to_step_form import to_step_form
from msnn.agreement.judgement import FloatType, drawn_record
from msnn.agreement.subject import bits_of_each, worst_deviation
from msnn.exports.check import check_export
from msnn.exports.export import plan_exports, write_export
from msnn.exports.table import TARGETS
from msnn.exports.target import AnyPlan
from msnn.model.load import load_model
from msnn.model.weights.weights_file import initial_weights
from spec_schema.diagnostics.diagnostic import Findings
from tests.agreement.exported import checked, plan_of
from tests.conditions import require_tool
from tests.programs import SAMPLES

TYPES: list[tuple[str, FloatType]] = [
    ("torch", "float64"),
    ("torch", "float32"),
    ("casadi", "float64"),
    ("onnx", "float64"),
    ("onnx", "float32"),
    ("c", "float64"),
    ("c", "float32"),
    ("fmu", "float32"),
]


def test_every_target_is_compared() -> None:
    """A target that steps a model has a row of TYPES; controllers and filters have no samples."""
    stepped = {target.name for target in TARGETS if not target.sections}
    missing = stepped - {target for target, _ in TYPES}
    assert not missing, f"give {missing} a row of TYPES in {__file__}"


def plan_of_sample(sample: str, target: str, dtype: FloatType) -> AnyPlan:
    program = SAMPLES[sample]().program
    names = [output.name for output in program.outputs]
    return plan_of(target, to_step_form(prune_outputs(program, names)), dtype)


@pytest.mark.parametrize("sample", SAMPLES)
@pytest.mark.parametrize(("target", "dtype"), TYPES, ids=lambda value: value)
def test_every_sample_agrees(sample: str, target: str, dtype: FloatType, tmp_path: Path):
    require_tool("gcc", install="apt install gcc")
    plan = plan_of_sample(sample, target, dtype)
    weights = initial_weights(plan.program)
    record = drawn_record(plan.program, "drawn")
    found = checked(plan, weights, tmp_path, record)
    assert found.agrees, found
    assert found.steps == record.steps > 100


@pytest.mark.parametrize("target", ["torch", "onnx", "casadi", "c"])
def test_other_weights_do_not_agree(target: str, tmp_path: Path):
    require_tool("gcc", install="apt install gcc")
    plan = plan_of_sample("fir_closed_loop", target, "float32" if target == "c" else "float64")
    weights = initial_weights(plan.program)
    others = {name: value * (1 + 1e-6) for name, value in weights.items()}
    assert not checked(plan, weights, tmp_path, written=others).agrees


REMEMBERS = """msnn: 1
name: m
sample_time: 10 ms
inputs: {u: {}}
states: {x: {next: 0.9 * x + u, init: 0.3 * u}}
outputs: {y: x}
"""


@pytest.mark.parametrize(("target", "dtype"), TYPES, ids=lambda value: value)
def test_other_first_states_do_not_agree(target: str, dtype: FloatType, tmp_path: Path):
    require_tool("gcc", install="apt install gcc")
    plans: list[AnyPlan] = []
    for name, text in {"one": REMEMBERS, "other": REMEMBERS.replace("0.3", "0.31")}.items():
        spec = tmp_path / f"{name}.msnn.yaml"
        spec.write_text(text, encoding="utf-8")
        plans += [
            replace(p, dtype=dtype) for p in plan_exports(load_model(spec), [target], Findings())
        ]
    plan, other = plans
    written = write_export(other, {}, tmp_path / "out")
    found = check_export(plan, {}, written, drawn_record(plan.program, "drawn"))
    assert "the first state `x`" in [fault.of for fault in found.faults]


def test_deviation_is_relative_to_the_largest_magnitude():
    wanted = {"a": np.array([1.0, -4.0]), "b": np.array([0.0, 0.0])}
    assert worst_deviation({"a": np.array([1.1, -4.0]), "b": wanted["b"]}, wanted) == (
        pytest.approx(0.1 / 4)
    )
    assert worst_deviation({"a": wanted["a"], "b": np.array([0.0, 1e-300])}, wanted) == math.inf
    assert worst_deviation({"a": wanted["a"][:1], "b": wanted["b"][:1]}, wanted) == 0


def test_nan_and_infinity_must_stand_at_equal_places():
    wanted = {"a": np.array([1.0, math.nan, math.inf])}
    assert worst_deviation(wanted, wanted) == 0
    assert worst_deviation({"a": np.array([1.0, 2.0, math.inf])}, wanted) == math.inf
    assert worst_deviation({"a": np.array([1.0, math.nan, -math.inf])}, wanted) == math.inf
    assert worst_deviation({"a": np.array([math.nan, math.nan, math.inf])}, wanted) == math.inf


def test_bits_count_the_sign_of_zero_but_not_the_kind_of_nan():
    one = {"a": np.array([0.0, math.nan, 1.0], np.float32)}
    other = {"a": np.array([-0.0, -math.nan, 1.0], np.float32)}
    assert bits_of_each(one, one) == {"a": 0}
    assert bits_of_each(one, other) == {"a": 1}


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_the_jacobian_of_c_is_compared_too(dtype: FloatType, tmp_path: Path) -> None:
    require_tool("gcc", install="apt install gcc")
    plain = plan_of_sample("joint_arm", "c", dtype)
    plan = replace(plain, options=COptions(extras=("jacobian", "parameter_jacobian")))
    weights = initial_weights(plan.program)
    written = write_export(plan, weights, tmp_path)
    record = drawn_record(plan.program, "drawn")
    assert check_export(plan, weights, written, record).agrees
    (source,) = (file for file in written.files if file.name == "model.c")
    text = source.read_text(encoding="utf-8")
    spoiled, count = re.subn(r"(jac->A\[[^]]*\] = )(?!0\.0)", r"\g<1>2.0f * ", text, count=1)
    assert count == 1
    source.write_text(spoiled, encoding="utf-8")
    assert not check_export(plan, weights, written, record).agrees


SHORTER_WINDOW = """msnn: 1
name: m
sample_time: 10 ms
inputs: {u: {}}
states:
  x: {der: u - x, init: x.meas}
  v: {der: x - v, init: "x.meas[t+1] - x.meas"}
outputs: {y: x + v}
"""


def test_a_state_that_c_takes_from_the_caller_leaves_shorter_windows(tmp_path: Path):
    """`v` begins at a later sample of `x`, so that C's `reset` reads one sample of it, not two."""
    require_tool("gcc", install="apt install gcc")
    spec = tmp_path / "m.msnn.yaml"
    spec.write_text(SHORTER_WINDOW, encoding="utf-8")
    model = load_model(spec)
    (plan,) = plan_exports(model, ["c"], Findings())
    assert checked(plan, {}, tmp_path / "c").agrees
