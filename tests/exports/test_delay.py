"""`delay` of the C export: ports of the newest sample, and outputs that many samples late."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from textwrap import dedent
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import msnn
from compiler.interpreter.interpreter import Interpreter
from compiler.passes.close_loop import close_loop
from compiler.passes.simplify import prune_outputs
from compiler.passes.to_step_form import to_step_form
from msnn.exports.check import check_export
from msnn.exports.describe import exports_text
from msnn.exports.export import plan_exports, write_export
from msnn.exports.running.built_c import built_c
from msnn.exports.target import Written
from msnn.model.model import Model
from msnn.project.workflow_checks import checked_model
from spec_schema.diagnostics.diagnostic import Findings, SpecError
from tests.agreement.exported import drawn_record
from tests.conditions import require_tool

Array = NDArray[np.float64]

HEAD = "msnn: 1\nname: rig\nsample_time: 0.1 s\n"
RIG = """
inputs:
  u: {between: linear, range: [-3, 3]}
  w: {range: [-3, 3]}
  slow: {range: [-3, 3]}
states:
  x: {der: v, init: 0.5, range: [-20, 20]}
  v: {der: force, init: x.meas / 2, range: [-20, 20]}
equations:
  force: "u * 0.7 - x - 0.5 * v + w - 0.2 * slow[t-2]"
outputs:
  y: {expr: 2 * x, predicts: "x[t]"}
  z: {expr: "v + u[t-1]", doc: speed}
"""
PLAIN = RIG.replace("x.meas / 2", "0")


def model_of(folder: Path, text: str) -> Model:
    (folder / "rig.msnn.yaml").write_text(HEAD + dedent(text))
    return msnn.load(folder / "rig.msnn.yaml")


def written(model: Model, folder: Path) -> Written:
    require_tool("gcc", "apt-get install gcc")
    findings = Findings()
    (plan,) = plan_exports(model, ["c"], findings)
    findings.raise_errors()
    return write_export(plan, dict(msnn.initial_weights(model)), folder)


def log_of(rows: int = 40) -> dict[str, Array]:
    random = np.random.default_rng(3)
    return {name: random.uniform(-3, 3, rows) for name in ("u", "w", "slow", "x")}


def runs(model: Model, log: Mapping[str, Array], t0: int, steps: int) -> dict[str, Array]:
    """The model in float32 by the interpreter, in window form: nothing of the delay in it."""
    single = {name: series.astype(np.float32) for name, series in log.items()}
    program = prune_outputs(model.program, ["y", "z"])
    found = Interpreter(program, {}, np.float32).rollout(single, np.array([t0]), steps).outputs
    return {name: values[0] for name, values in found.items()}


def about(folder: Path) -> dict[str, Any]:
    return json.loads((folder / "rig.json").read_text(encoding="utf-8"))


def windows(folder: Path, log: Mapping[str, Array], first_call: int) -> dict[str, Array]:
    """What `reset` takes before a first call at that row, as the JSON file says it."""
    ports = about(folder)["start_windows"]
    return {
        port["name"]: log[port["name"]][
            first_call + port["first_sample"] : first_call + port["last_sample"] + 1
        ]
        for port in ports
    }


def ports_at(log: Mapping[str, Array], t: int) -> dict[str, float]:
    return {"u": log["u"][t], "w": log["w"][t], "slow": log["slow"][t - 2]}


def test_delayed_c_gives_the_bits_of_the_model_one_sample_late(tmp_path: Path) -> None:
    model = model_of(tmp_path, RIG + "export: {c: {delay: [u]}}")
    log, t0, steps = log_of(), 3, 30
    expected = runs(model, log, t0, steps)
    with built_c(written(model, tmp_path / "c")) as step:
        assert step.input_shapes == {"u": (), "w": (), "slow": ()}
        given = windows(tmp_path / "c", log, t0 + 1)
        np.testing.assert_array_equal(given["x"], log["x"][[t0]])
        shapes = step.start_shapes
        status = step.reset({name: values.reshape(shapes[name]) for name, values in given.items()})
        assert status == 0
        for k in range(steps):
            outputs, status = step.step(ports_at(log, t0 + 1 + k))
            assert status == 0
            for name in ("y", "z"):
                np.testing.assert_array_equal(outputs[name], expected[name][k])


def test_after_init_the_past_is_as_the_first_sample(tmp_path: Path) -> None:
    model = model_of(tmp_path, PLAIN + "export: {c: {delay: u}}")
    log, steps = log_of(), 20
    past = {
        name: np.concatenate([np.full(5, series[2]), series[3:]]) for name, series in log.items()
    }
    past["slow"] = np.concatenate([np.full(5, log["slow"][2]), log["slow"][3:]])
    expected = runs(model, past, 3, steps)
    with built_c(written(model, tmp_path / "c")) as step:
        step.init()
        for k in range(steps):
            outputs, _ = step.step(ports_at(past, 4 + k))
            for name in ("y", "z"):
                np.testing.assert_array_equal(outputs[name], expected[name][k])


def test_header_readme_and_data_say_that_the_step_is_late(tmp_path: Path) -> None:
    model = model_of(tmp_path, RIG + "export: {c: {delay: [u]}}")
    written(model, tmp_path / "c")
    header = (tmp_path / "c" / "include" / "rig.h").read_text(encoding="utf-8")
    assert "/* Outputs of a step: those of sample t-1. */" in header
    assert "predicts x[t-1]" in header
    assert "of sample t-1 where the inputs are those of sample t. */" in header
    assert "## Late by 1 sample\n" in (tmp_path / "c" / "README.md").read_text(encoding="utf-8")
    data = about(tmp_path / "c")
    assert data["late"] == 1
    assert data["outputs"][0]["predicts"] == {"signal": "x", "ahead": -1}
    assert [(p["name"], p["first_sample"], p["lag"]) for p in data["inputs"]] == [
        ("u", 0, 0),
        ("w", 0, 0),
        ("slow", -2, 2),
    ]
    assert "1 step late, predicts x[t-1]" in exports_text(model)


def test_without_a_delay_the_next_sample_is_a_preview(tmp_path: Path) -> None:
    model = model_of(tmp_path, RIG + "export: {c: {}}")
    written(model, tmp_path / "c")
    data = about(tmp_path / "c")
    assert "late" not in data
    (u,) = (port for port in data["inputs"] if port["name"] == "u")
    assert (u["first_sample"], u["last_sample"]) == (0, 1)
    assert "this sample and the next 1" in exports_text(model)


@pytest.mark.parametrize("options", ["", ", dtype: q15", ", with: jacobian", ", params: tunable"])
def test_every_kind_of_c_agrees_with_its_judge(options: str, tmp_path: Path) -> None:
    require_tool("gcc", "apt-get install gcc")
    text = PLAIN.replace("0.7", "gain").replace("states:", "parameters: {gain: 0.7}\nstates:", 1)
    model = model_of(tmp_path, text + f"export: {{c: {{delay: [u]{options}}}}}")
    findings = Findings()
    (plan,) = plan_exports(model, ["c"], findings)
    findings.raise_errors()
    weights = dict(msnn.initial_weights(model))
    export = write_export(plan, weights, tmp_path / "c")
    assert check_export(plan, weights, export, drawn_record(plan.program, "drawn")).agrees
    assert about(tmp_path / "c")["late"] == 1


def test_a_preview_of_three_samples_makes_the_step_three_late(tmp_path: Path) -> None:
    text = """
        inputs: {a: {}, b: {}, c: {}}
        outputs: {y: "sum(a[t-1:t+3]) + b + c[t+5]"}
        export: {c: {delay: [a], dtype: float64}}
        """
    model = model_of(tmp_path, text)
    log = {name: np.arange(30.0) * factor for name, factor in (("a", 1), ("b", 100), ("c", 1e4))}
    with built_c(written(model, tmp_path / "c")) as step:
        assert step.input_shapes == {"a": (), "b": (), "c": (3,)}
        given = windows(tmp_path / "c", log, 10)
        shapes = step.start_shapes
        step.reset({name: values.reshape(shapes[name]) for name, values in given.items()})
        for t in range(10, 20):
            now = {"a": log["a"][t], "b": log["b"][t], "c": log["c"][t : t + 3]}
            outputs, _ = step.step(now)
            at = t - 3
            expected = sum(log["a"][at - 1 : at + 4]) + log["b"][at] + log["c"][at + 5]
            np.testing.assert_array_equal(outputs["y"], expected)


@pytest.mark.parametrize("name", ["w", "nobody"])
def test_a_delay_of_what_is_not_read_ahead_is_an_error(name: str, tmp_path: Path) -> None:
    model_of(tmp_path, RIG + f"export: {{c: {{delay: [u, {name}]}}}}")
    with pytest.raises(SpecError) as caught:
        checked_model(tmp_path / "rig.msnn.yaml")
    assert [d.code for d in caught.value.diagnostics] == ["E0227"]


def test_a_late_loop_is_the_loop_of_an_earlier_sample(tmp_path: Path) -> None:
    """The fed-back signal is known a sample earlier too, and no port."""
    text = RIG.replace("slow: {", "x_log: {}\n  slow: {").replace(
        'predicts: "x[t]"', 'predicts: "x_log[t+1]"'
    )
    text = text.replace("- 0.2 * slow[t-2]", "- 0.2 * slow[t-2] + 0.1 * x_log[t-1]")
    program = close_loop(prune_outputs(model_of(tmp_path, text).program, ["y", "z"]), ["x_log"])
    log, rows = log_of() | {"x_log": log_of()["w"] / 2}, np.array([4])
    early, late = (
        Interpreter(to_step_form(program, samples)).rollout(log, rows + samples, 20).outputs
        for samples in (0, 1)
    )
    for name, values in early.items():
        np.testing.assert_array_equal(late[name], values)


def test_the_late_step_form_is_the_step_form_of_an_earlier_sample(tmp_path: Path) -> None:
    program = prune_outputs(model_of(tmp_path, RIG).program, ["y", "z"])
    log, rows = log_of(), np.array([4])
    found = [
        Interpreter(to_step_form(program, late)).rollout(log, rows + late, 20).outputs
        for late in (0, 1, 2)
    ]
    for one in found[1:]:
        for name, values in found[0].items():
            np.testing.assert_array_equal(one[name], values)
