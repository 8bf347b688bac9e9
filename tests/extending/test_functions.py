"""A function of a plug-in has the same values in all ways to run it, also in a sub-model."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from msnn.api.models import load
from msnn.cli.application import run
from msnn.features.language_server.completion import complete
from msnn.features.language_server.hover import hover
from msnn.model.program_file import write_program_file
from spec_schema import plugins
from spec_schema.diagnostics.diagnostic import SpecError
from tests.conditions import require_tool
from tests.extending.conftest import Install
from tests.extending.test_plugins import spec_file
from tests.features.language_server.marked import viewed
from tests.language.reference_case import BACKENDS, assert_case, read_case

CASE = Path(__file__).with_name("lerp.yaml")
SPEC = (
    "msnn: 1\nname: m\nsample_time: 1 s\ninputs: {u: {unit: N, range: [-1, 1]}}\n"
    "parameters: {k: {init: 0.5}}\noutputs: {y: 'lerp(u, 3 * u, k)'}\n"
)


@pytest.mark.usefixtures("example")
@pytest.mark.parametrize("backend", BACKENDS)
def test_a_function_of_a_plugin_agrees_in_every_backend(backend: str):
    require_tool("gcc", install="apt install gcc")
    assert_case(read_case(CASE), backend)


@pytest.mark.usefixtures("example")
def test_every_export_of_a_function_of_a_plugin_agrees(tmp_path: Path):
    require_tool("gcc", install="apt install gcc")
    file, out = spec_file(tmp_path, SPEC), str(tmp_path / "out")
    assert run(["show", str(file)]) == 0
    assert run(["export", str(file), "--initial", "--to", "all", "--check", "--out", out]) == 0


@pytest.mark.usefixtures("example")
def test_a_sub_model_may_call_it(tmp_path: Path):
    spec_file(tmp_path, SPEC)
    (tmp_path / "whole.msnn.yaml").write_text(
        "msnn: 1\nname: whole\nsample_time: 1 s\nuse: {part: {spec: m.msnn.yaml}}\n"
        "inputs: {f: {unit: N}}\nconnect: {part.u: f}\noutputs: {y: part.y}\n"
    )
    model = load(tmp_path / "whole.msnn.yaml")
    assert [plugin.package for plugin in model.program.plugins] == ["msnn-example"]
    assert load(write_program_file(model, tmp_path)).program.plugins == model.program.plugins


@pytest.mark.usefixtures("example")
def test_a_function_of_the_spec_comes_first(tmp_path: Path):
    text = SPEC + "functions: {lerp: {args: [a, b, c], expr: a}}\n"
    assert load(spec_file(tmp_path, text)).program.plugins == ()


@pytest.mark.usefixtures("example")
@pytest.mark.parametrize(
    ("call", "message"),
    [
        ("lerp(u, u)", "`lerp` takes 3 arguments"),
        ("lerp(u, u, k, over=k)", "`over`"),
    ],
)
def test_a_wrong_call_is_a_message(call: str, message: str, tmp_path: Path):
    text = SPEC.replace("lerp(u, 3 * u, k)", call)
    with pytest.raises(SpecError, match=message):
        load(spec_file(tmp_path, text))


@pytest.mark.usefixtures("example")
def test_its_units_are_checked(tmp_path: Path):
    text = SPEC.replace("{init: 0.5}", "{init: 0.5, unit: m}").replace("3 * u, k", "k, 0.5")
    assert [found.code for found in load(spec_file(tmp_path, text)).warnings] == ["W0504"]


@pytest.mark.usefixtures("example")
def test_editors_and_messages_know_it(tmp_path: Path):
    with pytest.raises(SpecError) as caught:
        load(spec_file(tmp_path, SPEC.replace("lerp", "lerq")))
    (found,) = caught.value.diagnostics
    assert found.replacement == "lerp"
    shown = hover(*viewed(SPEC.replace("lerp", "le|rp"), known=SPEC))
    assert shown is not None
    assert "a + share * (b - a)" in shown.text
    items = complete(*viewed(SPEC.replace("lerp(u", "le|(u"), known=SPEC))
    assert items is not None
    assert "lerp" in [item.label for item in items.items]


@pytest.mark.usefixtures("install")
def test_a_function_of_no_plugin_is_unknown(tmp_path: Path):
    with pytest.raises(SpecError, match="E0301"):
        load(spec_file(tmp_path, SPEC))


def test_a_function_of_ours_is_not_replaced(install: Install):
    record = """
from msnn.extending import Feature, FunctionLine, LateObject, Signature

FEATURE = Feature(name="stranger", functions=tuple(
    FunctionLine(name, Signature(1, 1), LateObject("stranger", "FEATURE"))
    for name in ("tanh", "relu", "der", "grad", "fine")
))
"""
    install("stranger", {"stranger.py": record}, "stranger:FEATURE")
    found = plugins.look_up()
    assert len(found.warnings) == 4
    assert "the function `tanh` of the package stranger" in found.warnings[0].message
    assert {w.message.partition(": ")[2] for w in found.warnings} == {
        "msnn has a function of this name"
    }
    assert found.found[0].keys == {("function", "fine")}
    # nor in a process that has not imported the compiler, such as that of `msnn doctor`
    program = "from spec_schema.plugins import look_up\nprint(*look_up().found[0].keys)"
    site = {"PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run(
        [sys.executable, "-c", program],
        env={**os.environ, **site},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout == "('function', 'fine')\n"
