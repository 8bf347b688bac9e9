"""A run keeps the URDF of its robot, and what it learned is read with it."""

import json
from pathlib import Path

import numpy as np
import pytest

import msnn
from msnn.model.load import load_model
from msnn.model.model_weights import choose_weights
from msnn.training.training_result import TrainingResult
from spec_schema.diagnostics.diagnostic import SpecError
from tests.conditions import require_tool
from tests.features.robots.robots import URDF

SPEC = """
msnn: 1
name: arm
sample_time: 10 ms
dims: {joint: [shoulder, elbow]}
use: {arm: {robot: {urdf: planar.urdf, joints: joint, learn: [mass]}}}
inputs: {q: {unit: rad, dims: joint}}
targets: {tau: {unit: N*m, dims: joint}}
outputs: {hold: arm.gravity_torque(q)}
losses: {fit: "mse(hold, tau)"}
data: {source: {train: train.csv}, columns: {q: "q{1..2}", tau: "tau{1..2}"}, time: t}
train: [{epochs: 60, optimizer: {adam: {lr: 0.05}}}]
"""


def trained(folder: Path) -> TrainingResult:
    """A run of an upper link of 3 kg and a lower one of 0.6 kg."""
    require_tool("gcc", install="apt-get install gcc")
    (folder / "planar.urdf").write_bytes((URDF / "planar.urdf").read_bytes())
    (folder / "arm.msnn.yaml").write_text(SPEC, encoding="utf-8")
    q = np.random.default_rng(0).uniform(-1, 1, (200, 2))
    outer = 0.6 * 0.2 * 9.81 * np.cos(q.sum(axis=1))
    inner = (3 * 0.25 + 0.6 * 0.5) * 9.81 * np.cos(q[:, 0]) + outer
    rows = np.column_stack((np.arange(200) * 0.01, q, inner, outer))
    header = "t,q1,q2,tau1,tau2"
    np.savetxt(folder / "train.csv", rows, delimiter=",", header=header, comments="")
    return msnn.train(load_model(folder / "arm.msnn.yaml"), runs=folder / "runs")


def test_masses_are_learned_and_the_run_stands_alone(tmp_path: Path) -> None:
    result = trained(tmp_path)
    np.testing.assert_allclose(result.weights["arm.mass"], [3.0, 0.6], rtol=0.05)
    assert result.folder is not None
    assert (result.folder / "parts" / "arm.urdf").read_bytes() == (
        tmp_path / "planar.urdf"
    ).read_bytes()
    record = json.loads((result.folder / "run.json").read_text(encoding="utf-8"))["parts"]["arm"]
    assert record["kind"] == "robot"
    (tmp_path / "planar.urdf").unlink()
    again = load_model(result.folder)
    assert [parameter.name for parameter in again.program.parameters] == ["arm.mass"]


def test_weights_of_another_urdf_are_refused_and_comments_are_none(tmp_path: Path) -> None:
    result = trained(tmp_path)
    assert result.folder is not None
    weights, urdf = result.folder / "weights.safetensors", tmp_path / "planar.urdf"
    text = urdf.read_text(encoding="utf-8")

    def chosen_with(now: str) -> None:
        urdf.write_text(now, encoding="utf-8")
        choose_weights(load_model(tmp_path / "arm.msnn.yaml"), weights, tmp_path / "runs")

    chosen_with(text)
    chosen_with(text.replace("</robot>", "<!-- seen from above --></robot>"))
    place = '<origin xyz="0.5 0 0"/>'
    assert text.count(place) == 1
    with pytest.raises(SpecError) as caught:
        chosen_with(text.replace(place, '<origin xyz="0.6 0 0"/>'))
    (fault,) = caught.value.diagnostics
    assert fault.code == "E0994"
    assert "of the robot `arm` the joint `elbow` is another one" in fault.message
    assert fault.help is not None
    assert "parts/arm.urdf" in fault.help
