"""Every spec of the gallery checks, trains, and exports C that has the interpreter's bits."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from compiler.ir.ops import Apply
from compiler.ir.scalars import SCALAR_FUNCTIONS
from msnn.cli.application import run
from msnn.model.load import load_model
from spec_schema.sections.layers import Layer
from spec_schema.sections.spec import Integrator
from tests.conditions import require_tool
from tests.examples.gallery import GALLERY, NAMES, gallery_copy, spec_of

TEXTS = {name: spec_of(GALLERY, name).read_text(encoding="utf-8") for name in NAMES}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return gallery_copy(tmp_path_factory.mktemp("gallery"))


def layers_of(text: str) -> set[str]:
    return {layer for layer in Layer.model_fields if re.search(rf"\{{?\b{layer}: *[{{\n]", text)}


def test_every_layer_is_somewhere_in_the_gallery() -> None:
    used = set[str]().union(*(layers_of(text) for text in TEXTS.values()))
    missing = {field for field in Layer.model_fields if field != "place"} - used
    assert not missing, f"use {missing} in a spec of examples/gallery"


def test_every_scalar_function_is_somewhere_in_the_gallery() -> None:
    programs = [load_model(spec_of(GALLERY, name)).program for name in NAMES]
    used = {
        node.op.function
        for program in programs
        for _, node in program.step
        if isinstance(node.op, Apply)
    }
    missing = set(SCALAR_FUNCTIONS) - used
    assert not missing, f"use {missing} in a spec of examples/gallery"


@pytest.mark.parametrize("policy", ["clamp", "hold", "flag", "trust"])
def test_every_policy_is_somewhere_in_the_gallery(policy: str) -> None:
    assert any(f"on_invalid: {policy}" in text for text in TEXTS.values())


def test_integrators_are_in_the_gallery() -> None:
    wanted = {field for field in Integrator.model_fields if field != "place"}
    assert {i for i in wanted if any(f"integrator: {{{i}:" in t for t in TEXTS.values())} == wanted


WARNED = {
    "two_tanks": ["W0743", "W0743"],  # what runs out of a tank is steep where it is empty
    "battery": ["W0901"],  # memories that no log shows begin at rest inside records too
    "cart_pole": ["W0901", "W0901"],
    "heater": ["W0901", "W0901"],
}


@pytest.mark.parametrize("name", NAMES)
def test_it_checks_trains_and_exports_the_same_bits(
    name: str, folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    require_tool("gcc", install="apt-get install gcc")
    spec, runs = str(spec_of(folder, name)), ["--runs", str(tmp_path / "runs")]
    assert run(["check", spec]) == 0
    assert re.findall(r"\[([EW]\d+)\]", capsys.readouterr().err) == WARNED.get(name, [])
    assert run(["train", spec, "--out", str(tmp_path / "runs")]) == 0
    capsys.readouterr()
    exported = ["--to", "c", "--check", "--format", "json", "--out", str(tmp_path / "out")]
    assert run(["export", spec, *runs, *exported]) == 0
    said = json.loads(capsys.readouterr().out)
    assert [target["bits"] for target in said["agreement"]["targets"]] == [0]
