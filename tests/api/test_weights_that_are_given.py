"""One door for weights: every function takes the same forms, and refuses what does not fit."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

import msnn
from msnn.model.weights.weights_file import write_weights
from tests.backends.test_torch_files import imported

SPEC = """
msnn: 1
name: plant
sample_time: 0.1 s
inputs: {x: m, u: N}
parameters:
  gain: {init: 0.5, min: -1, max: 0.6}
  force: {init: 0.1, unit: m/N}
  rest: {init: 0, unit: m}
layers: {h: {fir: {window: 3}}}
outputs: {x_next: {expr: gain*x + force*u + h(x) + rest, predicts: "x[t+1]"}}
train:
  - {epochs: 1, batch: 16, optimizer: {adam: {lr: 0.01}}, engine: torch}
"""

DATA = {"x": np.linspace(0, 1, 30), "u": np.ones(30)}

WEIGHTS: dict[str, Any] = {
    "gain": 0.25,
    "force": np.array(0.75, np.float32),
    "rest": 1,
    "h.weight": [0.5, 0.25, -1.0],
}


@pytest.fixture
def model(tmp_path: Path) -> msnn.Model:
    (tmp_path / "plant.yaml").write_text(SPEC)
    return msnn.load(tmp_path / "plant.yaml")


DOORS: dict[str, Callable[[msnn.Model, Any, Path], object]] = {
    "train": lambda model, weights, _: msnn.train(model, DATA, runs=None, weights=weights),
    "train_folds": lambda model, weights, _: msnn.train_folds(
        model, DATA, runs=None, weights=weights
    ),
    "stage_loss": lambda model, weights, _: msnn.stage_loss(model, DATA, weights=weights),
    "validate": lambda model, weights, _: msnn.validate(model, weights, DATA),
    "simulate": lambda model, weights, _: msnn.simulate(model, DATA, weights),
    "linearize": lambda model, weights, _: msnn.linearize(
        model, {"x": 0.0, "u": 0.0}, {"x.history": np.zeros(2)}, weights
    ),
    "export": lambda model, weights, folder: msnn.export(model, "c", folder / "out", weights),
}

MISTAKES = {
    "unknown": ({**WEIGHTS, "forse": 1.0}, "E0959", "did you mean `force`?"),
    "partial": (
        {"gain": 0.5},
        "E0911",
        "complete it: `{**msnn.initial_weights(model), **weights}`",
    ),
    "empty": ({}, "E0911", "complete it"),
    "misshapen": ({**WEIGHTS, "h.weight": [1.0, 2.0]}, "E0912", None),
    "not finite": ({**WEIGHTS, "rest": np.nan}, "E0923", None),
    "too large": ({**WEIGHTS, "gain": 0.61}, "E1119", "widen `min` and `max`"),
    "hardly too large": ({**WEIGHTS, "gain": 0.6 + 1e-6}, "E1119", "widen `min` and `max`"),
    "too small": ({**WEIGHTS, "gain": -1.001}, "E1119", "widen `min` and `max`"),
    "no numbers": ({**WEIGHTS, "rest": "much"}, "E0924", None),
    "ragged": ({**WEIGHTS, "h.weight": [[1.0], [2.0, 3.0]]}, "E0912", None),
}


@pytest.mark.parametrize("door", DOORS)
@pytest.mark.parametrize("mistake", MISTAKES)
def test_weights_that_do_not_fit_are_refused(
    model: msnn.Model, door: str, mistake: str, tmp_path: Path
) -> None:
    weights, code, repair = MISTAKES[mistake]
    with pytest.raises(msnn.SpecError) as caught:
        DOORS[door](model, weights, tmp_path)
    assert code in [diagnostic.code for diagnostic in caught.value.diagnostics]
    helps = " ".join(diagnostic.help or "" for diagnostic in caught.value.diagnostics)
    assert repair is None or repair in helps
    assert not (tmp_path / "out").exists()


def test_everything_wrong_is_said_at_once(model: msnn.Model) -> None:
    weights = {"forse": 1.0, "gain": np.inf, "h.weight": 1.0}
    with pytest.raises(msnn.SpecError) as caught:
        msnn.validate(model, weights, DATA)
    codes = [diagnostic.code for diagnostic in caught.value.diagnostics]
    assert codes == ["E0959", "E0911", "E0912", "E0923"]


def test_the_state_of_a_torch_module_is_no_weights(model: msnn.Model, tmp_path: Path) -> None:
    loss = msnn.stage_loss(model, DATA)
    with pytest.raises(msnn.SpecError, match="E0959") as caught:
        msnn.export(model, "c", tmp_path / "out", loss.state_dict())
    assert "loss.weights()" in (caught.value.diagnostics[0].help or "")
    assert not (tmp_path / "out").exists()


def test_every_form_gives_the_same_weights(model: msnn.Model, tmp_path: Path) -> None:
    path = write_weights(
        tmp_path / "weights.safetensors",
        {name: np.asarray(value, np.float64) for name, value in WEIGHTS.items()},
        model.program,
    )
    tensors = {
        name: torch.tensor(value, dtype=torch.bfloat16, requires_grad=True)
        for name, value in WEIGHTS.items()  # which bfloat16 holds without error
    }
    (expected,) = msnn.simulate(model, DATA, WEIGHTS)
    for given in (tensors, path, str(path), tmp_path):
        (found,) = msnn.simulate(model, DATA, given)
        np.testing.assert_array_equal(found.outputs["x_next"], expected.outputs["x_next"])


def test_results_of_training_are_weights(model: msnn.Model) -> None:
    result = msnn.train(model, DATA, runs=None)
    loss = msnn.stage_loss(model, DATA, weights=result)
    (expected,) = msnn.simulate(model, DATA, result.weights)
    for given in (result, loss, loss.weights()):
        (found,) = msnn.simulate(model, DATA, given)
        # the raw variables of a loss are float32
        np.testing.assert_allclose(found.outputs["x_next"], expected.outputs["x_next"], rtol=1e-5)


@pytest.fixture(scope="module")
def other_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of a model whose arrays fit, in another formula."""
    folder = tmp_path_factory.mktemp("other")
    (folder / "plant.yaml").write_text(SPEC.replace("gain*x + force", "gain*x - force"))
    found = msnn.train(msnn.load(folder / "plant.yaml"), DATA, runs=folder / "runs").folder
    assert found is not None
    return found


@pytest.mark.parametrize("door", DOORS)
@pytest.mark.parametrize("given", ["folder", "file"])
def test_the_run_of_another_model_is_refused(
    door: str, given: str, model: msnn.Model, other_run: Path, tmp_path: Path
) -> None:
    weights = other_run if given == "folder" else other_run / "weights.safetensors"
    with pytest.raises(msnn.SpecError) as caught:
        DOORS[door](model, weights, tmp_path)
    assert [found.code for found in caught.value.diagnostics] == ["E0994"]
    assert not (tmp_path / "out").exists()


def test_a_mapping_is_completed_by_the_initial_values(model: msnn.Model) -> None:
    weights = {**msnn.initial_weights(model), "gain": 0.0, "h.weight": np.zeros(3)}
    (found,) = msnn.simulate(model, DATA, weights)
    np.testing.assert_allclose(found.outputs["x_next"], 0.1, rtol=1e-12)


def test_other_things_are_no_weights(model: msnn.Model) -> None:
    with pytest.raises(TypeError, match="a mapping, a result of training or a path, not float"):
        msnn.validate(model, 3.0, DATA)  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize("bound", [-1.0, 0.6, float(np.float32(0.6))])
def test_a_bound_and_what_single_precision_made_of_it_are_inside(
    model: msnn.Model, bound: float, tmp_path: Path
) -> None:
    files = msnn.export(model, "torch", tmp_path, {**WEIGHTS, "gain": bound})
    (source,) = [path for path in files if path.suffix == ".py"]
    gain = imported(source).load().gain
    assert gain.item() == pytest.approx(bound, abs=3e-8)
    # −1 + 1.6 is rounded up
    assert -1.0 <= gain.item() <= np.nextafter(0.6, 1.0)
