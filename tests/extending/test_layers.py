"""A layer of a plug-in has the same values in all ways to run it, and learns as ours do."""

from __future__ import annotations

import importlib.metadata
from pathlib import Path

import pytest
from safetensors.numpy import load_file

from compiler import layers
from msnn.api.models import load
from msnn.cli.application import run
from msnn.model.program_file import write_program_file
from spec_schema import plugins
from spec_schema.diagnostics.diagnostic import SpecError
from spec_schema.reading.reader import read_spec
from tests.conditions import require_tool
from tests.extending.conftest import Install
from tests.extending.test_plugins import spec_file
from tests.language.reference_case import BACKENDS, assert_case, read_case

CASE = Path(__file__).with_name("dead_zone.yaml")
SPEC = (
    "msnn: 1\nname: valve\nsample_time: 1 s\ninputs: {u: {range: [-1, 1]}}\ntargets: {z: {}}\n"
    "layers: {f: {dead_zone: {width: 0.1}}}\n"
    "outputs: {y: {expr: f(u), predicts: 'z[t]'}}\n"
)


@pytest.mark.usefixtures("example")
@pytest.mark.parametrize("backend", BACKENDS)
def test_a_layer_of_a_plugin_agrees_in_every_backend(backend: str):
    require_tool("gcc", install="apt install gcc")
    assert_case(read_case(CASE), backend)


@pytest.mark.usefixtures("example")
def test_every_export_of_a_layer_of_a_plugin_agrees(tmp_path: Path):
    require_tool("gcc", install="apt install gcc")
    file, out = spec_file(tmp_path, SPEC), str(tmp_path / "out")
    assert run(["export", str(file), "--initial", "--to", "all", "--check", "--out", out]) == 0


@pytest.mark.usefixtures("example")
@pytest.mark.parametrize("engine", ["native", "torch"])
def test_the_width_is_learned(engine: str, tmp_path: Path):
    require_tool("gcc", install="apt install gcc")
    values = [k / 20 for k in range(-20, 21)]
    rows = "".join(f"{u},{max(u - 0.3, 0) + min(u + 0.3, 0)}\n" for u in values)
    (tmp_path / "log.csv").write_text(f"u,z\n{rows}")
    text = f"{SPEC}data: {{source: {{train: log.csv}}}}\n"
    text += f"train: [{{epochs: 300, optimizer: {{adam: {{lr: 0.01}}}}, engine: {engine}}}]\n"
    file = spec_file(tmp_path, text)
    assert run(["train", str(file), "--out", str(tmp_path / "runs")]) == 0
    (found,) = tmp_path.glob("runs/**/weights.safetensors")
    assert abs(float(load_file(found)["f.width"]) - 0.3) < 0.01


@pytest.mark.usefixtures("example")
def test_a_program_names_the_plugin_of_a_layer(tmp_path: Path):
    model = load(spec_file(tmp_path, SPEC))
    assert [plugin.package for plugin in model.program.plugins] == ["msnn-example"]
    assert load(write_program_file(model, tmp_path)).program.plugins == model.program.plugins


@pytest.mark.usefixtures("example")
def test_sub_models_have_arrays_of_their_own(tmp_path: Path):
    spec_file(tmp_path, SPEC)
    (tmp_path / "whole.msnn.yaml").write_text(
        "msnn: 1\nname: whole\nsample_time: 1 s\n"
        "use: {a: {spec: m.msnn.yaml}, b: {spec: m.msnn.yaml}}\ninputs: {u: {range: [-1, 1]}}\n"
        "connect: {a.u: u, b.u: a.y}\noutputs: {y: b.y}\n"
    )
    program = load(tmp_path / "whole.msnn.yaml").program
    assert [parameter.name for parameter in program.parameters] == ["a.f.width", "b.f.width"]
    assert [plugin.package for plugin in program.plugins] == ["msnn-example"]


@pytest.mark.usefixtures("example")
@pytest.mark.parametrize("cell", ["{dead_zone: {width: 0.1}}", "dead_zone"])
def test_a_cell_of_a_local_model_is_a_layer_of_ours(cell: str, tmp_path: Path):
    layer = f"{{local_model: {{by: s(u), cell: {cell}}}}}, s: {{fuzzify: {{centers: [-1, 1]}}}}"
    with pytest.raises(SpecError, match="unknown key `dead_zone` in a cell"):
        load(spec_file(tmp_path, SPEC.replace("{dead_zone: {width: 0.1}}", layer)))


@pytest.mark.usefixtures("install")
def test_a_layer_of_no_plugin_is_an_unknown_key(tmp_path: Path):
    with pytest.raises(SpecError, match="unknown key `dead_zone` in a layer"):
        load(spec_file(tmp_path, SPEC))


@pytest.mark.parametrize("written", ["{dead_zone: {width: 0.1}}", "dead_zone"])
def test_a_kind_of_layer_that_is_not_ours_is_looked_up(
    written: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    asked: list[str] = []
    monkeypatch.setattr(importlib.metadata, "entry_points", lambda group: asked.append(group) or ())
    plugins.forget()
    file = spec_file(tmp_path, SPEC.replace("{dead_zone: {width: 0.1}}", written))
    with pytest.raises(SpecError):
        read_spec(file)
    assert asked == [plugins.GROUP]
    plugins.forget()
    read_spec(spec_file(tmp_path, SPEC.replace("{dead_zone: {width: 0.1}}", "linear")))
    assert asked == [plugins.GROUP]
    plugins.forget()


def test_the_class_of_a_plugin_may_have_the_name_of_one_of_ours(install: Install):
    record = """
from msnn.extending import Entry, Feature, LateEntry, LateObject, LayerLine, LayerRule

class Linear(Entry):
    pass

RULE = LayerRule(Linear, print, print)
FEATURE = Feature(name="stranger", layers=(
    LayerLine("straight", LateEntry("stranger", "Linear"), LateObject("stranger", "RULE"), ""),
    LayerLine("linear", LateEntry("stranger", "Linear"), LateObject("stranger", "RULE"), ""),
))
"""
    install("stranger", {"stranger.py": record}, "stranger:FEATURE")
    found = plugins.look_up()
    assert ["the layer `linear` of the package stranger" in w.message for w in found.warnings] == [
        True
    ]
    (line,) = found.found[0].feature.layers[:1]
    assert layers.rule_of(line.entry.kind).settings is line.entry.kind
