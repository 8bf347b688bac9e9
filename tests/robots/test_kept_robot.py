"""A run keeps the URDF of its robot, and what it learned is read with it."""

from pathlib import Path

import numpy as np

import msnn
from msnn.model.load import load_model
from tests.conditions import require_tool
from tests.robots.robots import URDF

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


def test_masses_are_learned_and_the_run_stands_alone(tmp_path: Path) -> None:
    require_tool("gcc", install="apt-get install gcc")
    (tmp_path / "planar.urdf").write_bytes((URDF / "planar.urdf").read_bytes())
    (tmp_path / "arm.msnn.yaml").write_text(SPEC, encoding="utf-8")
    q = np.random.default_rng(0).uniform(-1, 1, (200, 2))
    # an upper link of 3 kg, a lower one of 0.6 kg
    outer = 0.6 * 0.2 * 9.81 * np.cos(q.sum(axis=1))
    inner = (3 * 0.25 + 0.6 * 0.5) * 9.81 * np.cos(q[:, 0]) + outer
    rows = np.column_stack((np.arange(200) * 0.01, q, inner, outer))
    header = "t,q1,q2,tau1,tau2"
    np.savetxt(tmp_path / "train.csv", rows, delimiter=",", header=header, comments="")
    result = msnn.train(load_model(tmp_path / "arm.msnn.yaml"), runs=tmp_path / "runs")
    np.testing.assert_allclose(result.weights["arm.mass"], [3.0, 0.6], rtol=0.05)
    assert result.folder is not None
    assert (result.folder / "parts" / "arm.urdf").read_bytes() == (
        tmp_path / "planar.urdf"
    ).read_bytes()
    (tmp_path / "planar.urdf").unlink()
    again = load_model(result.folder)
    assert [parameter.name for parameter in again.program.parameters] == ["arm.mass"]
