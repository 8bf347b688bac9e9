"""Compares robots with axes a little aside of x, y and z with MuJoCo, and records a few states.

Programs for drawing write such axes. A number of a direction moves the mass matrix by about its own
size, so axes put straight by mistake are seen from 1e-10 on. Of 200 states for each size two go to
`tests/features/robots/oracles/oblique.npz` with the URDFs, for
`tests/features/robots/test_oracles.py`.

    python benchmarks/robots/oblique_axes.py

Needs `pip install mujoco`, which the suite does not.
"""

from __future__ import annotations

import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import mujoco
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))

from benchmarks.robots.states import ROOT, Array, Robot, computed, drawn, error_of

ASIDE = tuple(10.0**power for power in range(-12, -5))
STATES, RECORDED = 200, 2
_LINK = """
  <link name="{0}"><inertial><origin xyz="0.3 -0.4 0.2" rpy="0.3 0.1 -0.5"/><mass value="{1}"/>
    <inertia ixx="0.4" ixy="0.02" ixz="-0.03" iyy="0.7" iyz="0.05" izz="0.5"/></inertial></link>"""
_JOINT = """
  <joint name="{0}" type="{1}"><parent link="{2}"/><child link="{0}_link"/>
    <origin xyz="0.5 0.2 -0.3"/><axis xyz="{3}"/></joint>"""


def chain(aside: float) -> str:
    """A URDF with six joints along ±x, ±y and ±z, tilted by `aside`."""
    text, parent = '<robot name="oblique">\n  <link name="floor"/>', "floor"
    kinds = ("continuous", "continuous", "prismatic", "continuous", "prismatic", "continuous")
    for number, kind in enumerate(kinds):
        axis = np.array([1.0 if number % 2 else -1.0, aside, -0.7 * aside])
        numbers = " ".join(repr(float(one)) for one in np.roll(axis, number % 3))
        text += _LINK.format(f"joint{number}_link", 3.0 - 0.4 * number)
        text += _JOINT.format(f"joint{number}", kind, parent, numbers)
        parent = f"joint{number}_link"
    return text + "\n</robot>\n"


def by_mujoco(text: str, log: dict[str, Array]) -> dict[str, Array]:
    """Mass matrices, bias forces C(q, dq) dq + g(q), and accelerations by MuJoCo."""
    head = '<mujoco><compiler balanceinertia="false" fusestatic="true"/></mujoco>'
    named = '<robot name="oblique">'
    model = mujoco.MjSpec.from_string(text.replace(named, named + head)).compile()
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    data = mujoco.MjData(model)
    found: dict[str, list[Array]] = {"mass": [], "bias": [], "forward": []}
    for q, dq, tau in zip(log["q"], log["dq"], log["tau"], strict=True):
        data.qpos[:], data.qvel[:], data.qfrc_applied[:] = q, dq, tau
        mujoco.mj_forward(model, data)
        mass = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, mass)
        found["mass"].append(mass)
        found["bias"].append(data.qfrc_bias.copy())
        found["forward"].append(data.qacc.copy())
    return {name: np.array(values) for name, values in found.items()}


def main() -> None:
    kept: dict[str, list[Array]] = {}
    texts: list[str] = []
    log = drawn(6, STATES)
    for aside in ASIDE:
        text = chain(aside)
        with TemporaryDirectory() as folder:
            file = Path(folder) / "oblique.urdf"
            file.write_text(text, encoding="utf-8")
            program = Robot("oblique", file, "joint5_link").program()
        found, expected = computed(program, log), by_mujoco(text, log)
        found["bias"] = found["coriolis"] + found["gravity"]
        errors = {name: error_of(found[name], values) for name, values in expected.items()}
        print(f"{aside:.0e}: MuJoCo", {name: f"{error:.1e}" for name, error in errors.items()})
        assert max(errors.values()) <= 1e-10
        texts.append(text)
        for name, values in (log | expected).items():
            kept.setdefault(name, []).append(values[:RECORDED])
    folder = ROOT / "tests" / "features" / "robots" / "oracles"
    recorded = {name: np.array(values) for name, values in kept.items() if name != "ddq"}
    np.savez_compressed(folder / "oblique.npz", urdf=np.array(texts), **recorded)


if __name__ == "__main__":
    main()
