"""R11, R12: which layers of sub-models are fitted, and that a resumed run is not fitted again."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from compiler.ir.ops import ReadSignal
from msnn.model.weights.weights_file import initial_weights
from msnn.training.records.training_options import TrainingOptions
from msnn.training.starts.initial_weights import first_weights
from msnn.training.train import train
from msnn.training.training_result import TrainingInterruptedError
from tests.language.submodels.submodels import model_of, write_weights
from tests.training.cases import compiled, dataset
from tests.training.records.test_interruption import Interrupting
from tests.training.starts.test_filter_fits import LAYERS, MODEL, TRUE, filtered

PART = """
inputs: {u: V}
targets: {y: m}
layers: {f: {iir: {num: 2, den: 3, fit: "y[t+1]"}}}
outputs: {z: {expr: f(u), unit: m}}
losses: {fit: "mse(z, y[t+1])"}
"""
WHOLE = """
inputs: {v: V}
targets: {w: m}
use: {part: {spec: part.yaml%s}}
parameters: {gain: 1}
outputs: {z: gain * part.z}
losses: {fit: "mse(z, w)"}
"""
GIVEN = {"f.num": [0.1, 0.2, 0.3], "f.reflection": [0.1, -0.2, 0.3]}


def test_a_layer_of_a_sub_model_is_fitted_to_signals_of_the_sub_model(tmp_path: Path) -> None:
    program = model_of(tmp_path, WHOLE % "", part=PART).program
    (fit,) = program.fits
    assert (fit.layer, fit.target.signal) == ("part.f", "part.y")
    assert [node.op for node in fit.argument.nodes] == [ReadSignal("part.u", 0, 0)]


@pytest.mark.parametrize(
    "more",
    [
        ", weights: part.safetensors",
        ", weights: part.safetensors, freeze: [f.num]",
        ", weights: part.safetensors, freeze: all",
        ", freeze: all",
        ", freeze: [f.reflection]",
    ],
)
def test_given_weights_and_frozen_ones_are_not_fitted(more: str, tmp_path: Path) -> None:
    write_weights(tmp_path / "part.safetensors", GIVEN)
    program = model_of(tmp_path, WHOLE % more, part=PART).program
    assert not program.fits
    assert "part.y" not in {signal.name for signal in program.signals}
    series = filtered([0.5, -0.2, 0.7], TRUE, 60)
    data = dataset({"part.u": series["u"], "w": series["y"]}, train=[60])
    found = first_weights(program, data)
    for name, value in initial_weights(program).items():
        np.testing.assert_array_equal(found[name], value)
    if "weights" in more and "part.f.num" in found:
        np.testing.assert_array_equal(found["part.f.num"], GIVEN["f.num"])


def test_a_connected_input_is_no_signal_to_fit_to(tmp_path: Path) -> None:
    connected = WHOLE.replace("use:", "connect: {part.u: 2 * v}\nuse:")
    program = model_of(tmp_path, connected % "", part=PART).program
    assert not program.fits
    assert program.parameter("part.f.num").learn


@pytest.mark.parametrize("kind", ["iir", "state_space"])
def test_a_resumed_run_goes_on_from_its_checkpoint(kind: str, tmp_path: Path) -> None:
    program, spec = compiled(MODEL.format(layer=LAYERS[kind], more=""))
    data = dataset(filtered([0.5, -0.2, 0.7], TRUE, 120), train=[80], val=[40])
    undisturbed = train(program, data, spec.train, TrainingOptions(runs=None))
    with pytest.raises(TrainingInterruptedError):
        train(
            program,
            data,
            spec.train,
            TrainingOptions(runs=tmp_path),
            Interrupting("stage_1", 1),
        )
    resumed = train(program, data, spec.train, TrainingOptions(runs=tmp_path, resume=True))
    for name, value in undisturbed.weights.items():
        np.testing.assert_array_equal(resumed.weights[name], value)
