"""Compares robots with pinocchio, ADAM and MuJoCo, and records what pinocchio says for the tests.

Needs `pip install pin adam-robotics mujoco`, which the suite does not. 500 random states of each
robot are compared; the first 50 go to `tests/features/robots/oracles/NAME.npz`, three of them to
the reference cases `tests/language/cases/robots/NAME.yaml`, which run in every backend.

    python benchmarks/robots/record_oracles.py
"""

from __future__ import annotations

import re
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import mujoco
import numpy as np
import pinocchio as pin
from adam import Representations
from adam.numpy import KinDynComputations

sys.path.insert(0, str(Path(__file__).parents[2]))

from benchmarks.robots.floating_base import twist
from benchmarks.robots.states import (
    ROBOTS,
    ROOT,
    Array,
    Robot,
    computed,
    drawn,
    error_of,
    joints_of,
    turning_tree,
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
    """Accelerations by ADAM, from its mass matrix and bias force."""
    base_of = 6 if robot.floats else 0
    adam = KinDynComputations(
        str(robot.file), list(labels[base_of:]), gravity=np.array([0, 0, -9.81, 0, 0, 0.0])
    )
    adam.set_frame_velocity_representation(Representations.MIXED_REPRESENTATION)
    rotors = np.diag(np.where(np.arange(len(labels)) < base_of, 0.0, robot.armature))
    found: list[Array] = []
    for q, dq, tau in zip(log["q"], log["dq"], log["tau"], strict=True):
        place, speed = np.eye(4), np.zeros(6)
        if robot.floats:
            base = twist(q, dq, of_body=False)
            place[:3, :3], place[:3, 3] = base.rotation, q[:3]
            dv, torque = base.speeds(dq), base.forces(tau)
            mass = np.asarray(adam.mass_matrix(place, q[6:])) + rotors
            bias = np.asarray(adam.bias_force(place, q[6:], dv[:6], dq[6:])).ravel()
            found.append(base.accelerations(np.linalg.solve(mass, torque - bias), dq))
        else:
            mass = np.asarray(adam.mass_matrix(place, q))[6:, 6:] + rotors
            bias = np.asarray(adam.bias_force(place, q, speed, dq)).ravel()[6:]
            found.append(np.linalg.solve(mass, tau - bias))
    return np.array(found)


def by_mujoco(robot: Robot, labels: tuple[str, ...], log: dict[str, Array]) -> Array:
    """Accelerations by MuJoCo."""
    text = robot.file.read_text(encoding="utf-8")
    text = re.sub(r"<limit[^>]*/>", "", text).replace('type="revolute"', 'type="continuous"')
    fuse = "false" if robot.floats else "true"
    head = f'<mujoco><compiler balanceinertia="false" fusestatic="{fuse}"/></mujoco>'
    text = re.sub(r"(<robot[^>]*>)", rf"\1{head}", text, count=1)
    spec = mujoco.MjSpec.from_string(text)
    if robot.floats:
        spec.worldbody.first_body().add_freejoint()
    model = spec.compile()
    model.opt.gravity[:] = [0, 0, -9.81]
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_LIMIT
    base_of = 6 if robot.floats else 0
    model.dof_armature[base_of:] = robot.armature
    joints = [model.joint(name) for name in labels[base_of:]]
    order = np.array([*range(base_of), *(joint.dofadr[0] for joint in joints)])
    places = np.array([joint.qposadr[0] for joint in joints])
    data = mujoco.MjData(model)
    found: list[Array] = []
    for q, dq, tau in zip(log["q"], log["dq"], log["tau"], strict=True):
        data.qpos[places] = q[base_of:]
        if robot.floats:
            base = twist(q, dq, of_body=True)
            data.qpos[:3] = q[:3]
            mujoco.mju_mat2Quat(data.qpos[3:7], base.rotation.ravel())
            data.qvel[order], data.qfrc_applied[order] = base.speeds(dq), base.forces(tau)
            mujoco.mj_forward(model, data)
            found.append(base.accelerations(data.qacc[order], dq))
        else:
            data.qvel[order], data.qfrc_applied[order] = dq, tau
            mujoco.mj_forward(model, data)
            found.append(data.qacc[order].copy())
    return np.array(found)


def record(
    robot: Robot, labels: tuple[str, ...], log: dict[str, Array], found: dict[str, Array]
) -> None:
    folder = ROOT / "tests" / "features" / "robots" / "oracles"
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
    inputs = ", ".join(f"{n}: {{dims: arm.joint}}" for n in log)
    lines += [f"inputs: {{{inputs}}}"]
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
    with TemporaryDirectory() as folder:
        for robot in (*ROBOTS, turning_tree(Path(folder))):
            compare(robot)


def compare(robot: Robot) -> None:
    """Prints the errors of msnn against every other program, and saves pinocchio's results for
    tests.
    """
    program = robot.program()
    labels = joints_of(program)
    log = drawn(len(labels), STATES)
    found, expected = computed(program, log), by_pinocchio(robot, labels, log)
    errors = {name: error_of(found[name], values) for name, values in expected.items()}
    print(f"{robot.name}: pinocchio", {n: f"{e:.1e}" for n, e in errors.items()})
    assert max(errors.values()) <= 1e-10
    others = {"MuJoCo": by_mujoco}
    if not robot.slides:  # ADAM 0.5 stops at a prismatic joint
        others["ADAM"] = by_adam
    for name, compute in others.items():
        error = error_of(found["forward"], compute(robot, labels, log))
        print(f"{robot.name}: {name} {error:.1e}")
        assert error <= 1e-10
    if robot.recorded:
        record(robot, labels, log, expected)


if __name__ == "__main__":
    main()
