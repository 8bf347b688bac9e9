"""`msnn import` on the command line: files, warnings, refusals."""

from __future__ import annotations

import json

from msnn.cli.exit_codes import ExitCode
from tests.cli.command_line import CommandLine
from tests.features.nnodely.recorded_model import recorded
from tests.features.nnodely.saved_model import saved, with_function

LAYERS = recorded("layers")


def test_an_import_is_simulated_at_once(msnn: CommandLine) -> None:
    (msnn.folder / "plant.json").write_text(LAYERS["connected"].model, encoding="utf-8")
    said = msnn("import", "plant.json")
    assert said.code == ExitCode.OK
    assert said.out.splitlines()[0] == "plant.msnn.yaml, plant.safetensors"
    (msnn.folder / "log.csv").write_text("x\n1\n2\n3\n4\n", encoding="utf-8")
    weights = ("--weights", "plant.safetensors")
    said = msnn("simulate", "plant.msnn.yaml", *weights, "--data", "log.csv")
    assert said.code == ExitCode.OK
    assert "1 run, 4 steps" in said.out


def test_warnings_show_the_place_in_the_file(msnn: CommandLine) -> None:
    (msnn.folder / "plant.json").write_text(LAYERS["closed_with_target"].model, encoding="utf-8")
    said = msnn("import", "plant.json", "-o", "other.msnn.yaml", "--format", "json")
    assert said.code == ExitCode.OK
    assert "warning[W1303]" in said.err
    assert "plant.json:" in said.err
    found = json.loads(said.out)
    assert found["spec"] == "other.msnn.yaml"
    assert found["inputs"] == {"u": "u", "x": "x"}


def test_a_refusal_shows_the_line_of_the_function(msnn: CommandLine) -> None:
    model = with_function("def f(x):\n    return open(x)\n")
    (msnn.folder / "plant.json").write_text(json.dumps(model, indent=1), encoding="utf-8")
    said = msnn("import", "plant.json")
    assert said.code == ExitCode.DIAGNOSTICS
    assert "error[E1313]" in said.err
    assert "the line is `return open(x)`" in said.err
    assert [path.name for path in msnn.folder.iterdir()] == ["plant.json"]


def test_a_file_or_folder_that_is_not_there(msnn: CommandLine) -> None:
    said = msnn("import", "plant.json")
    assert (said.code, "error[E1308]" in said.err) == (ExitCode.DIAGNOSTICS, True)
    (msnn.folder / "plant.json").write_text(json.dumps(saved()), encoding="utf-8")
    said = msnn("import", "plant.json", "-o", "plant.json/spec.msnn.yaml")
    assert said.code != ExitCode.BUG
    assert [path.name for path in msnn.folder.iterdir()] == ["plant.json"]


def test_a_folder_is_neither_a_model_nor_a_spec(msnn: CommandLine) -> None:
    (msnn.folder / "plant.json").write_text(json.dumps(saved()), encoding="utf-8")
    said = msnn("import", ".")
    assert (said.code, "error[E1308]" in said.err) == (ExitCode.DIAGNOSTICS, True)
    said = msnn("import", "plant.json", "-o", ".")
    assert (said.code, "error[E1316]" in said.err) == (ExitCode.DIAGNOSTICS, True)
    assert [path.name for path in msnn.folder.iterdir()] == ["plant.json"]


def test_a_spec_is_yaml_by_its_name(msnn: CommandLine) -> None:
    (msnn.folder / "plant.json").write_text(json.dumps(saved()), encoding="utf-8")
    said = msnn("import", "plant.json", "-o", "new.json")
    assert said.code == ExitCode.USAGE
    assert "does not end with .msnn.yaml" in said.err
    assert [path.name for path in msnn.folder.iterdir()] == ["plant.json"]
