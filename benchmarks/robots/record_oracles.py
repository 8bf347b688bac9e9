"""Compares robots with pinocchio, ADAM and MuJoCo, and records what pinocchio says for the tests.

Needs `pip install pin adam-robotics mujoco`, which the suite does not. 500 random states of each
robot are compared; the first 50 go to `tests/robots/oracles/NAME.npz`, three of them to the
reference cases `tests/language/cases/robots/NAME.yaml`, which run in every backend.

    python benchmarks/robots/record_oracles.py
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
from adam import Representations
from adam.numpy import KinDynComputations

sys.path.insert(0, str(Path(__file__).parents[2]))

from benchmarks.robots.states import (
    ROBOTS,
    ROOT,
    Array,
    Robot,
    computed,
    drawn,
    error_of,
    joints_of,
)

STATES, RECORDED, IN_CASES = 500, 50, 3
_BASE = {"base_x": 0, "base_y": 1, "base_z": 2, "base_yaw": 3, "base_pitch": 4, "base_roll": 5}
"""Where a floating base has its joints in pinocchio: a translation, then a spherical ZYX joint."""


def by_pinocchio(robot: Robot, labels: tuple[str, ...], log: dict[str, Array]) -> dict[str, Array]:
    file = str(robot.file)
    if robot.floats:
        root = pin.JointModelComposite(2)
        root.addJoint(pin.JointModelTranslation())
        root.addJoint(pin.JointModelSphericalZYX())
        model = pin.buildModelFromUrdf(file, root)
    else:
        model = pin.buildModelFromUrdf(file)
    model.gravity.linear = np.array([0.0, 0.0, -9.81])
    order = np.array(
        [_BASE[n] if n in _BASE else model.joints[model.getJointId(n)].idx_v for n in labels]
    )
    moving = [n not in _BASE for n in labels]
    rotors = np.zeros(model.nv)
    rotors[order[moving]] = robot.armature
    model.armature = rotors
    data, tip = model.createData(), model.getFrameId(robot.tip)
    found: dict[str, list[Array]] = {}
    for row in range(len(log["q"])):
        values = {name: np.zeros(model.nv) for name in log}
        for name, series in log.items():
            values[name][order] = series[row]
        q = pin.neutral(model)
        for joint in model.joints[1:]:
            at = values["q"][joint.idx_v : joint.idx_v + joint.nv]
            whole = [np.cos(at[0]), np.sin(at[0])] if joint.nq > joint.nv else at
            q[joint.idx_q : joint.idx_q + joint.nq] = whole
        dq, still = values["dq"], np.zeros(model.nv)
        mass = np.triu(pin.crba(model, data, q))
        mass = mass + np.triu(mass, 1).T
        gravity = pin.rnea(model, data, q, still, still)
        bias = pin.rnea(model, data, q, dq, still)
        results = {
            "forward": pin.aba(model, data, q, dq, values["tau"])[order],
            "inverse": pin.rnea(model, data, q, dq, values["ddq"])[order],
            "mass": mass[np.ix_(order, order)],
            "gravity": gravity[order],
            "coriolis": (bias - gravity)[order],
        }
        pin.forwardKinematics(model, data, q, dq)
        pin.updateFramePlacements(model, data)
        results["position"] = data.oMf[tip].translation.copy()
        aligned = pin.LOCAL_WORLD_ALIGNED
        results["velocity"] = pin.getFrameVelocity(model, data, tip, aligned).linear.copy()
        for name, value in results.items():
            found.setdefault(name, []).append(np.array(value))
    return {name: np.array(values) for name, values in found.items()}


def by_adam(robot: Robot, labels: tuple[str, ...], log: dict[str, Array]) -> Array:
    """Accelerations; ADAM knows floating bases by their own velocities, so only for fixed ones."""
    adam = KinDynComputations(
        str(robot.file), list(labels), gravity=np.array([0, 0, -9.81, 0, 0, 0.0])
    )
    adam.set_frame_velocity_representation(Representations.BODY_FIXED_REPRESENTATION)
    base, still = np.eye(4), np.zeros(6)
    found: list[Array] = []
    for q, dq, tau in zip(log["q"], log["dq"], log["tau"], strict=True):
        mass = np.asarray(adam.mass_matrix(base, q))[6:, 6:] + robot.armature * np.eye(len(q))
        bias = np.asarray(adam.bias_force(base, q, still, dq)).ravel()[6:]
        found.append(np.linalg.solve(mass, tau - bias))
    return np.array(found)


def by_mujoco(robot: Robot, labels: tuple[str, ...], log: dict[str, Array]) -> Array:
    """Accelerations, of bases that are fixed."""
    text = robot.file.read_text(encoding="utf-8")
    text = re.sub(r"<limit[^>]*/>", "", text).replace('type="revolute"', 'type="continuous"')
    text = re.sub(r'(<joint[^>]*type="continuous"[^>]*>)', r"\1", text)
    head = '<mujoco><compiler balanceinertia="false" fusestatic="true"/></mujoco>'
    text = re.sub(r"(<robot[^>]*>)", rf"\1{head}", text, count=1)
    text = text.replace('type="prismatic">', 'type="prismatic">')
    model = mujoco.MjModel.from_xml_string(text)
    model.opt.gravity[:] = [0, 0, -9.81]
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_LIMIT
    model.dof_armature[:] = robot.armature
    order = np.array([model.joint(name).dofadr[0] for name in labels])
    data = mujoco.MjData(model)
    found: list[Array] = []
    for q, dq, tau in zip(log["q"], log["dq"], log["tau"], strict=True):
        data.qpos[order], data.qvel[order], data.qfrc_applied[order] = q, dq, tau
        mujoco.mj_forward(model, data)
        found.append(data.qacc[order].copy())
    return np.array(found)


def record(
    robot: Robot, labels: tuple[str, ...], log: dict[str, Array], found: dict[str, Array]
) -> None:
    folder = ROOT / "tests" / "robots" / "oracles"
    folder.mkdir(exist_ok=True)
    kept = {name: values[:RECORDED] for name, values in (log | found).items()}
    np.savez_compressed(folder / f"{robot.name}.npz", **kept)
    lines = [f"# Written by benchmarks/robots/record_oracles.py from {robot.file.name}."]
    lines += ["msnn: 1", f"name: {robot.name}", "sample_time: 10 ms"]
    path = f"../../../../{robot.file.relative_to(ROOT)}"
    base = ", base: floating" if robot.floats else ""
    rotor = f", armature: {robot.armature}" if robot.armature else ""
    lines += [
        f"use: {{arm: {{robot: {{urdf: {path}{base}{rotor}, frames: {{tip: {robot.tip}}}}}}}}}"
    ]
    lines += ["inputs:", *(f"  {n}: {{dims: arm.joint}}" for n in log)]
    lines += ["outputs:", "  forward: arm.forward_dynamics(q, dq, tau)"]
    lines += ["  inverse: arm.inverse_dynamics(q, dq, ddq)", "  mass: arm.mass_matrix(q)"]
    lines += ["  gravity: arm.gravity_torque(q)", "  coriolis: arm.coriolis(q, dq)"]
    lines += ["  position: arm.tip.position(q)", "  velocity: arm.tip.jacobian(q, dq)"]
    lines += ["x-case:", f"  source: pinocchio {pin.__version__}", "  log:"]
    lines += [f"    {n}: {v[:IN_CASES].tolist()}" for n, v in log.items()]
    # what single elimination steps of an ill-conditioned mass matrix may lose
    lines += ["  tolerance: 1e-10", "  expected:"]
    lines += [f"    {n}: {v[:IN_CASES].tolist()}" for n, v in found.items()]
    cases = ROOT / "tests" / "language" / "cases" / "robots"
    cases.mkdir(exist_ok=True)
    (cases / f"{robot.name}.yaml").write_text("\n".join(lines) + "\n", encoding="utf-8")


def main() -> None:
    for robot in ROBOTS:
        program = robot.program()
        labels = joints_of(program)
        log = drawn(len(labels), STATES)
        found, expected = computed(program, log), by_pinocchio(robot, labels, log)
        errors = {name: error_of(found[name], values) for name, values in expected.items()}
        print(f"{robot.name}: pinocchio", {n: f"{e:.1e}" for n, e in errors.items()})
        assert max(errors.values()) <= 1e-10
        if not robot.floats:
            others = {"MuJoCo": by_mujoco}
            if not robot.slides:  # ADAM 0.5 stops at a prismatic joint
                others["ADAM"] = by_adam
            for name, compute in others.items():
                error = error_of(found["forward"], compute(robot, labels, log))
                print(f"{robot.name}: {name} {error:.1e}")
                assert error <= 1e-10
        record(robot, labels, log, expected)


if __name__ == "__main__":
    main()
