"""R11 and R13: models with sub-models are trained, kept in program files and exported."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import msnn
from compiler.passes.simplify import prune_outputs
from msnn.model.load import load_model, with_engine
from msnn.model.model import Model
from msnn.model.model_data import read_data
from msnn.model.model_weights import redrawn_weights
from msnn.model.program_file import write_program_file
from msnn.project.workflow_checks import check_workflow
from msnn.training.records.run_record import differences
from spec_schema.diagnostics.diagnostic import SpecError
from tests.language.submodels.submodels import diagnostics, model_of, names, run, write_weights

PLANT = """
    inputs: {x: V, u: V}
    parameters: {a: 0.5, b: 2}
    outputs: {x_next: {expr: a * x + b * u, predicts: "x[t+1]"}}
    """
CONTROLLED = """
    use: {plant: {spec: plant.yaml, weights: plant.safetensors, freeze: FREEZE}}
    inputs: {r: V}
    parameters: {gain: 0.1}
    states:
      x: {unit: V, next: plant.x_next, init: x.meas}
      i: {unit: V, next: i + r - x}
    connect: {plant.x: x, plant.u: u}
    outputs: {u: "gain * (r - x) + 0.1 * i"}
    losses: {track: "mse(x, r)"}
    data: {source: {train: data.csv}, columns: {r: ref, x: position}}
    train: [{name: all, epochs: 3, batch: 4, rollout: {horizon: 5}}]
    validate: [{of: plant.x_next, target: "r[t+1]", rollout: 5}]
    export: {c: {outputs: [u]}, onnx: {outputs: [u]}, casadi: {outputs: [u]}, torch: {outputs: [u]}}
    """


def controlled(folder: Path, freeze: str = "all") -> Model:
    write_weights(folder / "plant.safetensors", {"a": 0.8, "b": 1.0})
    random = np.random.default_rng(3)
    rows = np.round(random.normal(size=(40, 2)), 3)
    lines = ["ref,position", *(f"{r},{x}" for r, x in rows)]
    (folder / "data.csv").write_text("\n".join(lines) + "\n")
    return model_of(folder, CONTROLLED.replace("FREEZE", freeze), plant=PLANT)


def test_a_run_keeps_the_specs_of_its_parts(tmp_path: Path) -> None:
    result = msnn.train(controlled(tmp_path), runs=tmp_path / "runs")
    assert result.folder is not None
    kept = result.folder / "parts" / "plant.msnn.yaml"
    assert kept.read_text() == (tmp_path / "plant.yaml").read_text()
    recorded = json.loads((result.folder / "run.json").read_text())["parts"]["plant"]
    for key, file in (("spec_sha256", "plant.yaml"), ("weights_sha256", "plant.safetensors")):
        assert recorded[key] == hashlib.sha256((tmp_path / file).read_bytes()).hexdigest()


def test_a_resumed_run_says_which_part_has_changed() -> None:

    def record(spec: str, weights: str) -> dict[str, Any]:
        part = {"path": "plant.yaml", "spec_sha256": spec, "weights_sha256": weights}
        return {"spec_sha256": spec + weights, "stages": [], "parts": {"a.plant": part}}

    before = record("1", "2")
    assert differences(before, record("1", "2")) == []
    assert differences(before, record("1", "3")) == ["the weights of `a.plant` changed"]
    assert differences(before, record("3", "2")) == ["the spec of `a.plant` changed"]
    assert differences(before, before | {"spec_sha256": "4"}) == ["the spec has changed"]


def test_a_filter_may_read_an_input_of_a_part(tmp_path: Path) -> None:
    text = """
        use: {plant: {spec: plant.yaml, freeze: [a]}}
        inputs: {u: 1}
        constants: {least: 2}
        connect: {plant.u: u}
        outputs: {y: plant.x_next}
        losses: {fit: "mse(y, plant.x.meas[t+1])"}
        data: {source: {train: data.csv}, columns: {plant.x: x}, filter: "FILTER"}
        """
    (tmp_path / "data.csv").write_text("x,u\n1,1\n3,1\n4,1\n5,-1\n")
    plant = PLANT.replace("V", "'1'")
    for condition, kept in (("plant.x > least", [[1, 4]]), ("u * plant.x > 0", [[0, 3]])):
        model = model_of(tmp_path, text.replace("FILTER", condition), plant=plant)
        data = read_data(model, None, "training")
        assert data.episodes("train").tolist() == kept
    for condition, code in (("plant.y > 0", "E0739"), ("y > 0", "E0301"), ("plant.u > 0", "E0301")):
        model = model_of(tmp_path, text.replace("FILTER", condition), plant=plant)
        assert [d.code for d in check_workflow(model)] == [code]


def test_a_missing_column_of_a_part_says_how_to_name_it(tmp_path: Path) -> None:
    text = """
        use: {plant: {spec: plant.yaml}}
        inputs: {u: V}
        connect: {plant.u: u}
        outputs: {y: {expr: plant.x_next, predicts: "plant.x[t+1]"}}
        data: {source: {train: data.csv}}
        """
    (tmp_path / "data.csv").write_text("x,u\n1,1\n3,1\n")
    model = model_of(tmp_path, text, plant=PLANT)
    with pytest.raises(SpecError) as caught:
        read_data(model, None, "training")
    (found,) = caught.value.diagnostics
    assert found.code == "E0804"
    assert found.help is not None
    assert "`columns: {plant.x: x}` under `data:`" in found.help


@pytest.mark.parametrize("freeze", ["all", "none"])
def test_both_engines_train_alike(tmp_path: Path, freeze: str) -> None:
    model = controlled(tmp_path, freeze)
    native, torch = (
        msnn.train(with_engine(model, engine), runs=None).weights for engine in ("native", "torch")
    )
    assert sorted(native) == (["gain"] if freeze == "all" else ["gain", "plant.a", "plant.b"])
    assert native["gain"] != 0.1
    for name, value in native.items():
        # float32 sums in another order, over a few dozen steps of Adam
        np.testing.assert_allclose(value, torch[name], rtol=1e-4, err_msg=name)
    assert msnn.validate(model, native).passed


def test_a_program_file_needs_no_other_file(tmp_path: Path) -> None:
    model = controlled(tmp_path)
    file = write_program_file(model, tmp_path / "build")
    for name in ("plant.yaml", "plant.safetensors", "main.yaml"):
        (tmp_path / name).unlink()
    again = load_model(file)
    assert again.program == model.program
    assert list(again.spec.outputs) == list(model.spec.outputs)
    assert [part.name for part in again.parts] == ["plant"]
    log = {"r": np.ones(4), "x": np.zeros(4)}
    np.testing.assert_array_equal(
        run(again.program, log, steps=3, output="u"), run(model.program, log, steps=3, output="u")
    )


def test_another_start_keeps_what_weights_give(tmp_path: Path) -> None:
    text = """
        use: {part: {spec: part.yaml, weights: part.safetensors}}
        inputs: {u: V}
        parameters: {k: {init: {normal: {}}}}
        connect: {part.u: u}
        outputs: {y: k * part.y}
        """
    part = "inputs: {u: V}\nparameters: {k: {init: {normal: {}}}}\noutputs: {y: k * u}\n"
    write_weights(tmp_path / "part.safetensors", {"k": 3.0})
    model = model_of(tmp_path, text, part=part)
    first, second = (redrawn_weights(model, draw) for draw in (1, 2))
    assert first["k"] != second["k"]
    assert first["part.k"] == second["part.k"] == 3.0


def test_statistics_of_a_part_come_from_its_weights(tmp_path: Path) -> None:
    text = """
        use: {part: {spec: part.yaml, weights: part.safetensors, freeze: FREEZE}}
        inputs: {u: V}
        connect: {part.u: 10 * u}
        outputs: {y: part.y}
        """
    part = """
        inputs: {u: V}
        layers: {n: {normalize: {mean: data, std: data}}}
        outputs: {y: n(u)}
        """
    write_weights(tmp_path / "part.safetensors", {"n.mean": 4.0, "n.std": 2.0})
    for freeze, parameters in (("all", []), ("none", ["part.n.mean", "part.n.std"])):
        model = model_of(tmp_path, text.replace("FREEZE", freeze), part=part)
        assert sorted(names(model.program)["parameters"]) == parameters
        np.testing.assert_array_equal(run(model.program, {"u": [1.0]}), [3.0])
    text = text.replace(", weights: part.safetensors", "").replace("FREEZE", "all")
    assert [d.code for d in diagnostics(tmp_path, text, part=part)] == ["E0313"]
    # an input that nothing feeds is in the data
    text = text.replace("connect: {part.u: 10 * u}", "")
    program = model_of(tmp_path, text, part=part).program
    assert [p.statistic.signal for p in program.parameters if p.statistic] == ["part.u"] * 2


def test_the_hash_of_a_model_covers_its_parts(tmp_path: Path) -> None:
    before = controlled(tmp_path).program.spec_hash
    assert controlled(tmp_path).program.spec_hash == before
    write_weights(tmp_path / "plant.safetensors", {"a": 0.7, "b": 1.0})
    weights_changed = load_model(tmp_path / "main.yaml").program.spec_hash
    (tmp_path / "plant.yaml").write_text((tmp_path / "plant.yaml").read_text() + "# more\n")
    text_changed = load_model(tmp_path / "main.yaml").program.spec_hash
    assert len({before, weights_changed, text_changed}) == 3


def test_a_state_that_a_pruned_part_moves_is_a_port(tmp_path: Path) -> None:
    """The controller takes x from a sensor and keeps its integral. R13."""
    program = controlled(tmp_path).program
    pruned = prune_outputs(program, ["u"])
    assert names(pruned)["signals"] == ["r", "x"]
    assert names(pruned)["states"] == ["i"]
    whole = prune_outputs(program, ["u", "plant.x_next"])
    assert names(whole)["states"] == ["x", "i"]
    measured = np.array([1.0, 3.0, -2.0])
    found = run(pruned, {"r": np.zeros(3), "x": measured}, steps=3, output="u")
    np.testing.assert_allclose(found, [-0.1, -0.3 - 0.1, 0.2 - 0.4], rtol=1e-15)


def test_an_equation_that_an_export_names_is_an_output_of_it(tmp_path: Path) -> None:
    """docs/language.md, Export (R13)."""
    from msnn.exports.export import plan_exports
    from spec_schema.diagnostics.diagnostic import Findings

    text = """
        use: {part: {spec: part.yaml}}
        inputs: {u: V}
        equations: {half: u / 2, past: 3 * u.past(2), nothing: u + half}
        connect: {part.u: half}
        outputs: {y: u}
        export: {onnx: {outputs: [y, half, past, part.square]}, c: {}, casadi: {outputs: [y]}}
        """
    part = "inputs: {u: V}\nequations: {square: u * u}\noutputs: {y: square * 2}\n"
    model = model_of(tmp_path, text, part=part)
    assert [d.code for d in model.warnings] == ["W0301"]  # `nothing`
    plans = plan_exports(model, ("onnx", "c", "casadi"), Findings())
    found = [names(plan.program)["outputs"] for plan in plans]
    assert found == [["y", "half", "past", "part.square"], ["y", "part.y"], ["y"]]
    log = {"u": [1.0, 4.0]}
    np.testing.assert_array_equal(run(model.program, log, 1, output="half"), [2.0])
    np.testing.assert_array_equal(run(model.program, log, 1, output="past"), [[3.0, 12.0]])
    np.testing.assert_array_equal(run(model.program, log, 1, output="part.square"), [4.0])


def test_every_target_agrees_on_the_controller_alone(tmp_path: Path) -> None:
    """docs/language.md, Export (R13)."""
    from msnn.exports.check import check_exports
    from msnn.exports.export import plan_exports, write_export
    from msnn.exports.table import NAMES
    from spec_schema.diagnostics.diagnostic import Findings

    model = controlled(tmp_path)
    plans = plan_exports(model, NAMES, Findings())
    weights = {"gain": np.array(0.2)}
    out = tmp_path / "out"
    exports = [(plan, write_export(plan, weights, out / plan.target.name)) for plan in plans]
    found = check_exports(model, exports, weights, tmp_path)
    assert found.agrees
    assert not found.missing


@pytest.mark.parametrize(
    ("arrays", "said"),
    [
        ({"a": 1.0}, "the weights of `plant`: no values for `b`"),
        ({"a": [1.0, 2.0], "b": 1.0}, "the weights of `plant`: `a` has the shape [2], not []"),
        ({"a": np.nan, "b": 1.0}, "the weights of `plant`: `a` has values that are not finite"),
        ({"a": 1.0, "b": 1.0, "c": 1.0}, "the weights of `plant`: its spec declares no `c`"),
    ],
)
def test_weights_that_do_not_fit(tmp_path: Path, arrays: dict[str, object], said: str) -> None:
    controlled(tmp_path)
    write_weights(tmp_path / "plant.safetensors", arrays)  # pyright: ignore[reportArgumentType]
    try:
        found = load_model(tmp_path / "main.yaml").warnings
    except SpecError as error:
        found = error.diagnostics
    assert [d.message for d in found] == [said]
    assert found[0].span is not None
    assert (found[0].span.file, found[0].span.line) == (str(tmp_path / "main.yaml"), 5)


@pytest.mark.parametrize(
    ("weights", "options"),
    [
        ("none.safetensors", ""),
        ("runs/plant/latest/weights.safetensors", " --out FOLDER/runs"),
        ("../runs/plant/latest/weights.safetensors", " --out FOLDER/../runs"),
    ],
)
def test_the_training_that_is_named_keeps_its_weights_where_they_are_wanted(
    weights: str, options: str, tmp_path: Path
) -> None:
    text = f"""
        use: {{plant: {{spec: plant.yaml, weights: {weights}}}}}
        inputs: {{r: V}}
        connect: {{plant.x: r, plant.u: r}}
        outputs: {{y: plant.x_next}}
        """
    (found,) = diagnostics(tmp_path, text, plant=PLANT)
    command = f"`msnn train {tmp_path / 'plant.yaml'}{options}`".replace("FOLDER", str(tmp_path))
    assert command in (found.help or "")


def test_weights_that_are_not_there(tmp_path: Path) -> None:
    text = """
        use: {plant: {spec: plant.yaml, weights: none.safetensors}}
        inputs: {r: V}
        connect: {plant.x: r, plant.u: r}
        outputs: {y: plant.x_next}
        """
    (found,) = diagnostics(tmp_path, text, plant=PLANT)
    assert found.code == "E0740"
    assert "no such file" in found.message
    assert found.help is not None
    assert "msnn train" in found.help
    (tmp_path / "none.safetensors").write_bytes(b"{}")
    (found,) = diagnostics(tmp_path, text, plant=PLANT)
    assert "is not a safetensors file" in found.message


def test_weights_of_another_text(tmp_path: Path) -> None:
    model = controlled(tmp_path)
    own = model_of(tmp_path, "inputs: {x: 1}\noutputs: {y: x}\n").program
    for written_for, codes in ((own.spec_hash, ["W0742"]), (_hash_of_plant(tmp_path), [])):
        arrays = {"a": 0.8, "b": 1.0}
        write_weights(tmp_path / "plant.safetensors", arrays, spec_sha256=written_for)
        text = CONTROLLED.replace("FREEZE", "all")
        assert [d.code for d in diagnostics(tmp_path, text, plant=PLANT)] == codes
    assert not model.warnings


def _hash_of_plant(folder: Path) -> str:
    return load_model(folder / "plant.yaml").program.spec_hash
