"""Slices that a penalty took to 0: left out of every export, which computes the same with less."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import msnn
from compiler.interpreter.interpreter import Interpreter
from compiler.ir.ops import Contract
from compiler.ir.program import Program, Role
from compiler.ir.types import Type
from compiler.ir.verifier import verify
from compiler.passes.analyses.kept_slices import cut_weights
from compiler.passes.prune_zero_slices import prune_zero_slices
from compiler.passes.simplify import prune_outputs
from msnn.cli.application import run
from msnn.data.dataset import FloatArray
from msnn.exports.check import check_exports
from msnn.exports.export import plan_exports, target_names, write_export
from msnn.exports.table import NAMES
from msnn.features.comparison.trial import c_cost
from msnn.model.load import load_model
from msnn.model.model import Model
from msnn.reports.run_summary import read_run, run_text
from msnn.verification.proof_step import ARM_GCC, ARM_QEMU, GCC
from spec_schema.diagnostics.diagnostic import Findings
from tests.conditions import miss, require_tool

NET = """
msnn: 1
name: net
sample_time: 1 s
dims: {unit: 4, place: [front, left, rear]}
inputs: {u: 1, v: 1, q: {dims: place}}
targets: {z: 1}
layers:
  h: {fir: {window: 5, out: unit, bias: true}}
  o: {linear: {}}
  m: {mlp: {hidden: [6], activation: tanh}}
  s: {linear: {out: unit, bias: false}}
outputs:
  y: {expr: "o(tanh(h(u))) + m(u, v) + sum(s(q))", predicts: "z[t]"}
losses:
  fit: "mse(y, z)"
  a: "group(o.weight, over=unit)"
  b: "group(h.weight, over=samples)"
  c: "group(m.weight2, over=hidden1)"
  d: "group(s.weight, over=place)"
  e: "l1(m.weight1)"
export: {c: {}, torch: {}, casadi: {}, onnx: {}}
train: [{epochs: 1}]
"""
RANDOM = np.random.default_rng(5)
FIRST_STATE = RANDOM.bit_generator.state


@pytest.fixture(autouse=True)
def _every_test_draws_its_own_numbers() -> None:
    """Whatever runs before it."""
    RANDOM.bit_generator.state = FIRST_STATE


def some_weights(program: Program) -> dict[str, FloatArray]:
    return {p.name: RANDOM.normal(size=[axis.size for axis in p.axes]) for p in program.parameters}


def with_zeros(program: Program) -> dict[str, FloatArray]:
    weights = some_weights(program)
    weights["o.weight"][[1, 3]] = 0
    weights["h.weight"][:, [0, 1, 3]] = 0
    weights["m.weight2"][[0, 4]] = 0
    weights["m.weight1"][2] = 0
    weights["s.weight"][:, 1] = 0
    weights["s.weight"][2] = 0
    return weights


def products(program: Program) -> int:
    """How many products the contractions of a step take."""
    return sum(
        Type(
            tuple({a.name: a for arg in node.args for a in program.step[arg].type.axes}.values())
        ).size
        for _, node in program.step
        if isinstance(node.op, Contract)
    )


@pytest.fixture
def model(tmp_path: Path) -> Model:
    (tmp_path / "net.msnn.yaml").write_text(NET, encoding="utf-8")
    return load_model(tmp_path / "net.msnn.yaml")


def test_the_smaller_program_has_the_same_outputs(model: Model) -> None:
    weights = with_zeros(model.program)
    whole = prune_outputs(model.program, ["y"])
    found = prune_zero_slices(whole, weights, list(weights))
    verify(found.program)
    cut = cut_weights(found.cuts, weights)
    assert {p.name: cut[p.name].shape for p in found.program.parameters} == {
        p.name: tuple(axis.size for axis in p.axes) for p in found.program.parameters
    }
    rows = 30
    log = {"u": RANDOM.normal(size=rows), "v": RANDOM.normal(size=rows)}
    log["q"] = RANDOM.normal(size=(rows, 3))
    first = Interpreter(whole, weights).rollout(log, [6], 20).outputs["y"]
    second = Interpreter(found.program, cut).rollout(log, [6], 20).outputs["y"]
    # sums over fewer terms add 0 less often, which changes no bit
    np.testing.assert_array_equal(first, second)
    # 4·5 taps become 2·2, 4 units 2; 6·2 + 6 of the mlp become 3·2 + 4; 4·3 places become 3·2
    assert products(whole) == 20 + 4 + 18 + 12
    assert products(found.program) == 4 + 2 + 10 + 6


def test_a_program_without_zeros_is_the_same(model: Model) -> None:
    whole = prune_outputs(model.program, ["y"])
    found = prune_zero_slices(
        whole, some_weights(model.program), [p.name for p in whole.parameters]
    )
    assert found.program == whole
    assert not found.cuts


def test_everything_may_be_0(model: Model) -> None:
    weights = {name: 0 * value for name, value in some_weights(model.program).items()}
    whole = prune_outputs(model.program, ["y"])
    arrays = [name for name in weights if "weight" in name]
    weights["o.bias"] += 2.5
    found = prune_zero_slices(whole, weights, arrays)
    verify(found.program)
    assert products(found.program) == 0
    assert not found.program.signals


def test_every_target_agrees(model: Model, tmp_path: Path) -> None:
    require_tool("gcc", install="apt install gcc")
    weights = with_zeros(model.program)
    targets = target_names(["all"], None)  # but the controller, of which the spec says nothing
    plans = plan_exports(model, targets, Findings(), weights=weights)
    exports = [(plan, write_export(plan, weights, tmp_path / plan.target.name)) for plan in plans]
    report = check_exports(model, exports, weights, tmp_path)
    assert report.agrees, report
    assert {plan.target.name for plan in plans} == set(NAMES) - {"mpc"}
    # parameters of a unit are tunable: 0 may not stay 0
    assert [plan.target.name for plan in plans if not plan.cuts] == ["fmu"]


def test_c_takes_fewer_instructions(
    model: Model, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A step on a Cortex-M4F in QEMU, by the count of `msnn verify`."""
    for tool in (GCC, ARM_GCC, ARM_QEMU):
        if not tool.is_there:
            miss(f"{tool.command} is not installed: apt-get install {tool.package}")
    weights = with_zeros(model.program)
    (small,) = plan_exports(model, ["c"], Findings(), weights=weights)
    (whole,) = plan_exports(model, ["c"], Findings())
    steps: list[tuple[int, int]] = []
    for name, plan in {"small": small, "whole": whole}.items():
        write_export(plan, weights, tmp_path / name)
        capsys.readouterr()
        options = ["--targets", "m4", "--format", "json"]
        assert run(["verify", str(tmp_path / name), *options]) == 0
        found = json.loads(capsys.readouterr().out)
        figures = [row for result in found["results"] for row in result["figures"]]
        steps.append((figures[0]["instructions"][1], figures[0]["flash"]))
    (few, little), (many, much) = steps
    assert few < 0.7 * many
    assert little < much
    # comparisons rank models by the same count
    cost = c_cost(model, weights)
    assert cost is not None
    assert (cost.instructions, cost.flash) == (pytest.approx(few), little)


def test_tunable_arrays_stay_whole(model: Model) -> None:
    text = NET.replace("c: {}, torch", "c: {params: tunable}, torch")
    model.path.write_text(text, encoding="utf-8")
    again = load_model(model.path)
    (plan,) = plan_exports(again, ["c"], Findings(), weights=with_zeros(again.program))
    assert not plan.cuts


def test_a_run_names_what_is_0(tmp_path: Path) -> None:
    require_tool("gcc", install="apt install gcc")
    text = """
msnn: 1
name: few
dims: {place: [front, left, rear]}
inputs: {q: {dims: place}}
targets: {z: 1}
layers: {s: {linear: {bias: false}}}
outputs: {y: {expr: s(q), predicts: "z[t]"}}
losses: {fit: "mse(y, z)", few: {expr: "group(s.weight, over=place)", weight: 0.3}}
train: [{optimizer: levenberg_marquardt}]
"""
    spec = tmp_path / "few.msnn.yaml"
    spec.write_text(text, encoding="utf-8")
    q = RANDOM.normal(size=(60, 3))
    z = 2 * q[:, 0] + 0.05 * q[:, 1] + RANDOM.normal(0, 0.1, 60)
    model = msnn.load(spec)
    result = msnn.train(model, {"q": q, "z": z}, runs=tmp_path / "runs")
    assert result.folder is not None
    said = [{"array": "s.weight", "over": "place", "of": 3, "zero": ["left", "rear"]}]
    end = json.loads((result.folder / "run.json").read_text())["end"]
    assert end["zero_slices"] == said
    assert json.loads((result.folder / "parameters.json").read_text())["zero_slices"] == said
    assert "2 of the 3 slices of s.weight over place (left, rear)" in run_text(
        read_run(result.folder)
    )


SPARSE = """
msnn: 1
name: sparse
sample_time: 0.1 s
inputs: {u: 1, w: 1}
targets: {z: 1}
parameters: {a: 0.5, b: 0, c: 0.25, x0: 0}
states: {x: {next: 0.5 * x + u, init: x0}}
outputs:
  y: {expr: "x + a * x**2 - b * sin(w) + (b - c) * x**3 + b", predicts: "z[t]"}
losses: {fit: "mse(y, z)", few: {expr: "l1(a) + l1(b) + l1(c) + l1(x0)", weight: 0.1}}
export: {c: {dtype: float64}}
"""


def test_single_numbers_that_are_0_are_left_out_of_exports(tmp_path: Path) -> None:
    (tmp_path / "sparse.msnn.yaml").write_text(SPARSE, encoding="utf-8")
    model = load_model(tmp_path / "sparse.msnn.yaml")
    weights = {"a": np.array(0.5), "b": np.array(0.0), "c": np.array(0.25), "x0": np.array(0.0)}
    findings = Findings()
    (plan,) = plan_exports(model, ["c"], findings, weights=weights)
    assert [parameter.name for parameter in plan.program.parameters] == ["a", "c"]
    assert [signal.name for signal in plan.program.signals if signal.role is Role.INPUT] == ["u"]
    whole = prune_outputs(model.program, ["y"])
    found = prune_zero_slices(whole, weights, list(weights))
    verify(found.program)
    log = {"u": RANDOM.normal(size=30), "w": RANDOM.normal(size=30)}
    first = Interpreter(whole, weights).rollout(log, [0], 30).outputs["y"]
    second = Interpreter(found.program, weights).rollout(log, [0], 30).outputs["y"]
    np.testing.assert_array_equal(first, second)


def test_a_stepper_leaves_out_what_the_exported_c_does(model: Model, tmp_path: Path) -> None:
    require_tool("gcc", install="apt install gcc")
    (tmp_path / "sparse.msnn.yaml").write_text(SPARSE, encoding="utf-8")
    sparse = msnn.load(tmp_path / "sparse.msnn.yaml")
    # b is 0, and with it nothing reads w: the C has no such port
    step = msnn.stepper(sparse, {"a": 0.5, "b": 0.0, "c": 0.25, "x0": 0.0})
    assert step.step(u=2.0)["y"] == 0.0
    with pytest.raises(ValueError, match="w"):
        step.step(u=2.0, w=1.0)
    weights = with_zeros(model.program)
    whole, small = msnn.stepper(model, some_weights(model.program)), msnn.stepper(model, weights)
    judge = Interpreter(prune_outputs(model.program, ["y"]), weights)
    log = {"u": RANDOM.normal(size=12), "v": RANDOM.normal(size=12)}
    log["q"] = RANDOM.normal(size=(12, 3))
    expected = judge.rollout(log, [6], 5).outputs["y"][0]
    for t in range(11):
        sample = {name: values[t] for name, values in log.items()}
        found = small.step(**sample)["y"]
        whole.step(**sample)
        if t >= 6:
            assert found == pytest.approx(expected[t - 6], rel=1e-5)
