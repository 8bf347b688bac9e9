"""A robot is the plant of a predictive controller like any other states."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import msnn
from tests.conditions import require_tool
from tests.features.robots.robots import URDF, model_of

REACH = f"""
dims: {{joint: [shoulder, elbow]}}
use: {{arm: {{robot: {{urdf: {URDF / "planar.urdf"}, joints: joint}}}}}}
inputs: {{tau: {{unit: N*m, dims: joint, range: [-30, 30]}}}}
constants: {{radian: 1 rad, speed: 1 rad/s, torque: 1 N*m}}
states:
  q: {{unit: rad, dims: joint, der: dq, init: q.meas, range: [-4, 4]}}
  dq: {{unit: rad/s, dims: joint, der: ddq, init: dq.meas, range: [-20, 20]}}
integrator: semi_implicit
equations:
  ddq: arm.forward_dynamics(q, dq, tau)
outputs:
  q_next: {{expr: next(q), predicts: "q[t+1]"}}
  dq_next: {{expr: next(dq), predicts: "dq[t+1]"}}
  holding: arm.gravity_torque(q)
mpc:
  horizon: 12
  controls: [tau]
  references: {{wanted: {{unit: rad, dims: joint}}}}
  cost:
    stage: >-
      sum(((q - wanted) / radian)**2) + 0.01 * sum((dq / speed)**2)
      + 1e-6 * sum(((tau - arm.gravity_torque(wanted)) / torque)**2)
    terminal: 20 * sum(((q - wanted) / radian)**2) + sum((dq / speed)**2)
  bounds: {{tau: {{min: -25, max: 25}}}}
"""


def test_the_c_of_a_controller_brings_an_arm_to_its_place_and_holds_it(tmp_path: Path) -> None:
    require_tool("gcc", install="apt install gcc")
    model = model_of(tmp_path, REACH)
    controller = msnn.mpc(model)
    assert controller.solver == "c"
    arm = msnn.stepper(model, {})
    wanted = np.array([1.2, -0.8])
    at, speed, tau, holding = np.zeros(2), np.zeros(2), np.zeros(2), np.zeros(2)
    arm.reset(q=at, dq=speed)
    for _ in range(150):
        found = controller.solve({"q": at, "dq": speed}, references={"wanted": wanted})
        assert found.status.name == "SOLVED"
        tau = np.asarray(found.control["tau"])
        step = arm.step(tau=tau)
        at, speed, holding = (np.asarray(step[n]) for n in ("q_next", "dq_next", "holding"))
    np.testing.assert_allclose(at, wanted, atol=1e-4)  # a cost that is 0 at rest leaves no offset
    np.testing.assert_allclose(tau, holding, atol=2e-3)
