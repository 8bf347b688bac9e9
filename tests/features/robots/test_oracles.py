"""Robots move as pinocchio and MuJoCo say, at states that `benchmarks/robots` recorded."""

from pathlib import Path

import numpy as np
import pytest

from tests.features.robots.robots import HERE, URDF, Z1, model_of, outputs_at

ROBOTS = {
    "planar": f"{{urdf: {URDF}/planar.urdf, frames: {{tip: hand}}}}",
    "tree": f"{{urdf: {URDF}/tree.urdf, armature: 0.03, frames: {{tip: gripper}}}}",
    "floating": f"{{urdf: {URDF}/tree.urdf, base: floating, frames: {{tip: ram}}}}",
    "z1": f"{{urdf: {Z1}, armature: 0.02, frames: {{tip: gripper_mover}}}}",
}


@pytest.mark.parametrize("name", ROBOTS)
def test_fifty_states_are_those_of_pinocchio(name: str, tmp_path: Path) -> None:
    with np.load(HERE / "oracles" / f"{name}.npz") as file:
        recorded = {key: file[key] for key in file.files}
    model = model_of(
        tmp_path,
        f"""
        use: {{arm: {{robot: {ROBOTS[name]}}}}}
        inputs:
          q: {{dims: arm.joint}}
          dq: {{dims: arm.joint}}
          ddq: {{dims: arm.joint}}
          tau: {{dims: arm.joint}}
        outputs:
          forward: arm.forward_dynamics(q, dq, tau)
          inverse: arm.inverse_dynamics(q, dq, ddq)
          mass: arm.mass_matrix(q)
          gravity: arm.gravity_torque(q)
          coriolis: arm.coriolis(q, dq)
          position: arm.tip.position(q)
          velocity: arm.tip.jacobian(q, dq)
        """,
    )
    log = {key: recorded.pop(key) for key in ("q", "dq", "ddq", "tau")}
    found = outputs_at(model.program, log)
    for key, expected in recorded.items():
        scale = np.max(np.abs(expected))
        # two orders of summation of at most a few thousand numbers, and a solution of a system
        np.testing.assert_allclose(found[key], expected, rtol=0, atol=1e-10 * scale, err_msg=key)


@pytest.mark.parametrize("size", [0, 2, 4, 6], ids=lambda size: f"1e{size - 12}")
def test_axes_so_far_aside_of_x_y_and_z_are_those_of_mujoco(size: int, tmp_path: Path) -> None:
    """Recorded by `oblique_axes.py`; taken for x, y and z they were wrong by as much."""
    with np.load(HERE / "oracles" / "oblique.npz") as file:
        recorded = {key: file[key][size] for key in file.files}
    (tmp_path / "oblique.urdf").write_text(str(recorded.pop("urdf")), encoding="utf-8")
    model = model_of(
        tmp_path,
        """
        use: {arm: {robot: {urdf: oblique.urdf}}}
        inputs: {q: {dims: arm.joint}, dq: {dims: arm.joint}, tau: {dims: arm.joint}}
        outputs:
          mass: arm.mass_matrix(q)
          bias: "arm.inverse_dynamics(q, dq, 0)"
          forward: "arm.forward_dynamics(q, dq, tau)"
        """,
    )
    found = outputs_at(model.program, {key: recorded.pop(key) for key in ("q", "dq", "tau")})
    for key, expected in recorded.items():
        # 1e-13 is what sums and systems of these numbers lose by rounding in both programs
        atol = 1e-12 * np.max(np.abs(expected))
        np.testing.assert_allclose(found[key], expected, rtol=0, atol=atol, err_msg=key)


def test_two_links_in_a_plane_are_those_of_the_textbook(tmp_path: Path) -> None:
    """Siciliano et al.: Robotics, 2009, section 7.3.2, with angles from the horizontal."""
    model = model_of(
        tmp_path,
        f"""
        use: {{arm: {{robot: {{urdf: {URDF}/planar.urdf, armature: 0.3}}}}}}
        inputs: {{q: {{dims: arm.joint}}, dq: {{dims: arm.joint}}}}
        outputs: {{M: arm.mass_matrix(q), g: arm.gravity_torque(q), c: "arm.coriolis(q, dq)"}}
        """,
    )
    q, dq = np.array([[0.3, -0.8], [1.2, 2.0]]), np.array([[0.5, -1.5], [2.0, 0.7]])
    found = outputs_at(model.program, {"q": q, "dq": dq})
    m1, m2, l1, c1, c2, i1, i2, g0 = 2.0, 1.0, 0.5, 0.25, 0.2, 0.05, 0.02, 9.81
    cosine, sine = np.cos(q[:, 1]), np.sin(q[:, 1])
    low = i2 + m2 * c2**2
    mixed = low + m2 * l1 * c2 * cosine
    high = i1 + m1 * c1**2 + i2 + m2 * (l1**2 + c2**2 + 2 * l1 * c2 * cosine)
    M = np.array([[high + 0.3, mixed], [mixed, low + 0.3 + 0 * cosine]]).transpose(2, 0, 1)
    h = -m2 * l1 * c2 * sine
    c = np.stack([h * dq[:, 1] ** 2 + 2 * h * dq[:, 0] * dq[:, 1], -h * dq[:, 0] ** 2], axis=1)
    outer = m2 * c2 * g0 * np.cos(q.sum(axis=1))
    g = np.stack([(m1 * c1 + m2 * l1) * g0 * np.cos(q[:, 0]) + outer, outer], axis=1)
    for name, expected in {"M": M, "c": c, "g": g}.items():
        np.testing.assert_allclose(found[name], expected, rtol=1e-13, atol=1e-13, err_msg=name)


@pytest.mark.parametrize("around", [(2, 0, 1), (0, 1, 2), (1, 2, 0)])
@pytest.mark.parametrize("sign", [1, -1])
def test_an_axis_a_little_aside_of_x_y_or_z_is_itself(
    around: tuple[int, int, int], sign: int, tmp_path: Path
) -> None:
    """As programs for drawing write it: its largest number is 1 in float64, the others count."""
    x, y, z = np.array([3e-9, -7e-9, 1.0 * sign])[list(around)]
    moments, centre, mass = np.diag([0.4, 0.7, 0.5]), np.array([0.8, -1.1, 0.6]), 2.0
    (tmp_path / "arm.urdf").write_text(
        f"""<robot name="arm"><link name="base"/><link name="arm"><inertial>
        <origin xyz="0.8 -1.1 0.6"/><mass value="2"/>
        <inertia ixx="0.4" ixy="0" ixz="0" iyy="0.7" iyz="0" izz="0.5"/></inertial></link>
        <joint name="turn" type="revolute"><parent link="base"/><child link="arm"/>
        <axis xyz="{x} {y} {z}"/></joint></robot>""",
        encoding="utf-8",
    )
    model = model_of(
        tmp_path,
        """
        use: {arm: {robot: {urdf: arm.urdf, gravity: [1, 2, -9]}}}
        inputs: {q: {dims: arm.joint}}
        outputs: {M: arm.mass_matrix(q), g: arm.gravity_torque(q)}
        """,
    )
    found = outputs_at(model.program, {"q": [[0.0]]})
    axis = np.array([x, y, z]) / np.linalg.norm([x, y, z])
    arm = np.cross(axis, centre)
    inertia = axis @ moments @ axis + mass * arm @ arm
    torque = axis @ np.cross(centre, [-mass * 1, -mass * 2, mass * 9])
    np.testing.assert_allclose(found["M"], [[[inertia]]], rtol=1e-14)
    np.testing.assert_allclose(found["g"], [[torque]], rtol=1e-13)
