"""`--set` replaces any value of a spec, in every verb alike, and weights know their model."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from msnn.model.load import load_model
from spec_schema.editors.spec_data import spec_data
from tests.cli.command_line import CommandLine
from tests.cli.test_check import SPEC

SHORT = ("--set", "train.0.epochs=1", "--set", "train.0.engine=torch")

VALUES = {
    "parameters.k.init=11": ("parameters", "k", "init", 11),
    "parameters.k.max=30 N/m": ("parameters", "k", "max", "30 N/m"),
    "sample_time=0.1 s": ("sample_time", "0.1 s"),
    "states.x.init=0": ("states", "x", "init", "0"),
    "integrator.rk4.substeps=3": ("integrator", "rk4", "substeps", 3),
    "integrator=euler": ("integrator", "euler", "substeps", 1),
    "equations.a.expr=(F - k*x) / m": ("equations", "a", "expr", "(F - k * x) / m"),
    "inputs.F.range=[-5, 5]": ("inputs", "F", "range", [-5, 5]),
    "export.c.dtype=float64": ("export", "c", "dtype", "float64"),
}


@pytest.mark.parametrize("setting", VALUES)
def test_any_value_can_be_replaced(project: Path, setting: str) -> None:
    *path, expected = VALUES[setting]
    found = spec_data(load_model(SPEC, [setting]).spec)
    for step in path:
        found = found[str(step)]
    assert str(found).replace(" ", "") == str(expected).replace(" ", "") or found == expected
    assert str(found) != str(spec_data(load_model(SPEC).spec))


def test_a_shorthand_keeps_what_it_says(msnn: CommandLine) -> None:
    (msnn.folder / "a.yaml").write_text(
        "msnn: 1\nname: a\nsample_time: 0.1 s\ninputs: {u: m}\n"
        "parameters: {k: 0.25}\nlayers: {h: {fir: {window: 4}}}\n"
        "outputs: {y: k*h(u)}\ntrain:\n- {rollout: 5, epochs: 1}\n"
        "data: {source: {train: a.csv}}\n"
    )
    settings = ["parameters.k.max=3", "outputs.y.unit=m", "train.0.rollout.stride=2"]
    found = spec_data(load_model("a.yaml", settings).spec)
    assert (found["parameters"]["k"]["init"], found["parameters"]["k"]["max"]) == (0.25, 3)
    assert found["outputs"]["y"]["expr"] == "k * h(u)"
    assert found["train"][0]["rollout"]["horizon"] == 5


@pytest.mark.parametrize("verb", ["check", "compile", "validate", "simulate", "export", "show"])
def test_every_verb_that_reads_a_spec_takes_it(msnn: CommandLine, project: Path, verb: str) -> None:
    words = [verb, SPEC, "--set", "parameters.k.init=nonsense("]
    if verb in ("validate", "simulate", "export"):
        words += ["--initial"]
    said = msnn(*words)
    assert said.code == 1
    assert "--> --set:1:28" in said.err
    words[3] = "parameters.k.init=12"
    if verb == "export":
        words += ["--to", "c"]
    assert msnn(*words).code in (0, 3)


def test_exported_code_has_the_value_that_was_set(msnn: CommandLine, project: Path) -> None:
    for setting in ((), ("--set", "parameters.k.init=12.25")):
        assert msnn("export", SPEC, "--initial", "--to", "c", *setting).code == 0
        texts = [path.read_text() for path in Path("build/export/c").rglob("*.[ch]")]
        assert any("12.25" in text for text in texts) is bool(setting)


def test_the_hash_of_a_spec_is_of_the_model_that_was_set(project: Path) -> None:
    plain = load_model(SPEC).program.spec_hash
    assert load_model(SPEC, ["train.0.epochs=3"]).program.spec_hash == plain
    assert load_model(SPEC, ["parameters.k.init=12"]).program.spec_hash != plain


def test_a_program_file_keeps_what_was_set_and_takes_no_more_of_the_model(
    msnn: CommandLine, project: Path
) -> None:
    assert msnn("compile", SPEC, "--set", "parameters.k.init=12.25").code == 0
    program = "build/plant.program.json"
    shown = json.loads(msnn("show", program, "--format", "json").out)
    assert "12.25" in json.dumps(shown)
    assert msnn("check", program, "--set", "validate.0.max=1 km").code == 0
    said = msnn("check", program, "--set", "parameters.k.init=3")
    assert said.code == 1
    assert "error[E0996]: `parameters.k.init` cannot be set" in said.err


def test_weights_of_another_model_are_refused(msnn: CommandLine, project: Path) -> None:
    trained = ("--set", "parameters.k.max=40 N/m")
    assert msnn("train", SPEC, *SHORT, *trained).code == 0
    assert msnn("validate", SPEC, *trained).code in (0, 3)
    said = msnn("export", SPEC, "--to", "c")
    assert said.code == 1
    assert "error[E0994]" in said.err
    assert "`parameters.k.max` was 40 N/m, here it is not there" in said.err
    assert "--set 'parameters.k.max=40 N/m'" in said.err
    # another number of epochs is no other model, nor is another text in `doc`
    spec = Path(SPEC)
    spec.write_text(spec.read_text().replace("doc: mass}", "doc: the mass}"))
    assert msnn("validate", SPEC, "--set", "train.0.epochs=7", *trained).code in (0, 3)
    # a file that left its run is judged by its names and shapes
    shutil.copy("runs/plant/latest/weights.safetensors", "mine.safetensors")
    assert msnn("validate", SPEC, "--weights", "mine.safetensors").code in (0, 3)


def test_what_a_run_says_to_go_on_with_is_its_model(msnn: CommandLine, project: Path) -> None:
    assert msnn("train", SPEC, *SHORT, "--set", "parameters.k.max=40 N/m").code == 0
    shown = json.loads(msnn("show", "runs/plant/latest", "--format", "json").out)
    assert "--set 'parameters.k.max=40 N/m'" in json.dumps(shown)
