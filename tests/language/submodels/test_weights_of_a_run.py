"""R11: weights in the folder of their run are those of the model that the run has kept."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import msnn
from msnn.model.load import load_model
from tests.language.submodels.submodels import diagnostics, headed

INNER = "parameters: {g: 3}\ninputs: {s: V}\noutputs: {y: g * s}\n"
PLANT = """
use: {inner: {spec: inner.yaml}}
connect: {inner.s: u}
inputs: {x: V, u: V}
constants: {k: 2}
parameters: {a: 0.5}
outputs: {x_next: {expr: a * x + k * inner.y, predicts: "x[t+1]"}}
data: {source: {train: none.csv}}
train: [{epochs: 1, engine: torch}]
"""
MAIN = """
use: {plant: {spec: plant.yaml, weights: runs/plant/latest/weights.safetensors}}
inputs: {r: V}
connect: {plant.x: r, plant.u: r}
outputs: {y: plant.x_next}
"""


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("trained")
    (folder / "inner.yaml").write_text(headed("inner", INNER))
    (folder / "plant.yaml").write_text(headed("plant", PLANT))
    frame = {"x": np.arange(9.0), "u": np.ones(9)}
    msnn.train(load_model(folder / "plant.yaml"), frame, runs=folder / "runs")
    return folder


@pytest.mark.parametrize(
    ("plant", "inner", "codes"),
    [
        (PLANT, INNER, []),
        ("# a comment\n" + PLANT.replace("epochs: 1", "epochs: 9"), INNER, []),
        (PLANT.replace("a: 0.5", "a: {init: 0.5, doc: how slow}"), "doc: told\n" + INNER, []),
        (PLANT, INNER + "# a comment\n", []),
        (PLANT.replace("k: 2", "k: 3"), INNER, ["W0742"]),
        (PLANT, INNER.replace("g * s", "g * s + 1"), ["W0742"]),
    ],
)
def test_only_another_model_makes_its_weights_doubtful(
    trained: Path, plant: str, inner: str, codes: list[str]
) -> None:
    found = diagnostics(trained, MAIN, plant=plant, inner=inner)
    assert [d.code for d in found] == codes


def test_weights_without_their_run_are_compared_by_text(trained: Path) -> None:
    moved = trained / "moved.safetensors"
    moved.write_bytes((trained / "runs" / "plant" / "latest" / "weights.safetensors").read_bytes())
    main = MAIN.replace("runs/plant/latest/weights.safetensors", moved.name)
    for plant, codes in ((PLANT, []), (PLANT + "# a comment\n", ["W0742"])):
        found = diagnostics(trained, main, plant=plant, inner=INNER)
        assert [d.code for d in found] == codes
