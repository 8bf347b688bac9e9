"""Simulates the arm in MuJoCo: 15 episodes of 5 s that follow sums of sines, sampled at 100 Hz.

MuJoCo solves the rigid bodies with a step of 0.5 ms (Runge-Kutta of order 4); friction is added as
a passive torque. The torque of the motors is held over each sample, as the model assumes. Sensors
add noise to positions and speeds. The same seeds write the same files.

    python generate_data.py [--out data]

Needs `pip install mujoco`.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray
from truth import friction

Array = NDArray[np.float64]

HERE = Path(__file__).parent
EPISODES = {"train": range(10), "val": range(10, 12), "test": range(12, 15)}
SAMPLES, SAMPLE_TIME, STEP = 500, 0.01, 0.0005
ARMATURE = 0.02
POSITION_NOISE, SPEED_NOISE = 2e-4, 2e-3
LOW = np.array([-2.6, 0.05, -2.8, -1.45, -1.28, -2.7])
HIGH = np.array([2.6, 2.9, -0.05, 1.45, 1.28, 2.7])
FASTEST = 2.8
"""rad/s; the arm's limit is 3.14."""


def specification() -> mujoco.MjSpec:
    """The bodies of `z1.urdf`."""
    text = (HERE / "z1.urdf").read_text(encoding="utf-8")
    compiler = '<mujoco><compiler balanceinertia="false" fusestatic="true"/></mujoco>'
    text = text.replace('<robot name="z1">', f'<robot name="z1">{compiler}', 1)
    return mujoco.MjSpec.from_string(text)


def arm(with_friction: bool = True, step: float = STEP) -> mujoco.MjModel:
    """The arm, without contacts and limits."""
    mujoco.set_mjcb_passive(None)  # which MuJoCo calls while it compiles
    model = specification().compile()
    model.dof_armature[:] = ARMATURE
    model.opt.timestep = step
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_LIMIT)
    mujoco.set_mjcb_passive(_brake if with_friction else None)
    return model


def _brake(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    del model
    data.qfrc_passive[:] = -friction(data.qpos, data.qvel)


class Reference:
    """Sums of four sines for each joint, within its limits of position and speed."""

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng(1000 + seed)
        self.frequency = 2 * np.pi * rng.uniform(0.08, 0.6, (4, 6))
        self.phase = rng.uniform(0, 2 * np.pi, (4, 6))
        share = rng.uniform(0.3, 1.0, (4, 6))
        share /= share.sum(axis=0)
        room = (HIGH - LOW) / 2
        fastest = np.sum(share * self.frequency, axis=0)
        self.amplitude = share * np.minimum(0.9 * room, FASTEST / fastest)
        self.centre = (HIGH + LOW) / 2

    def at(self, t: float) -> tuple[Array, Array, Array]:
        """Position, speed and acceleration."""
        angle = self.frequency * t + self.phase
        q = self.centre + np.sum(self.amplitude * np.sin(angle), axis=0)
        dq = np.sum(self.amplitude * self.frequency * np.cos(angle), axis=0)
        ddq = -np.sum(self.amplitude * self.frequency**2 * np.sin(angle), axis=0)
        return q, dq, ddq


def computed_torque(
    model: mujoco.MjModel, data: mujoco.MjData, wanted: tuple[Array, Array, Array]
) -> Array:
    """M (ddq + PD) + bias: what moves the arm along a reference if it had no friction."""
    q, dq, ddq = wanted
    mass = np.zeros((6, 6))
    mujoco.mj_fullM(model, data, mass)
    acceleration = ddq + 100.0 * (q - data.qpos) + 20.0 * (dq - data.qvel)
    return mass @ acceleration + data.qfrc_bias


def episode(number: int) -> Array:
    """Rows of time, torques, positions and speeds as sensors see them."""
    model = arm()
    data = mujoco.MjData(model)
    reference, rng = Reference(number), np.random.default_rng(number)
    data.qpos[:], data.qvel[:], _ = reference.at(0.0)
    mujoco.mj_forward(model, data)
    rows: list[Array] = []
    for index in range(SAMPLES):
        t = index * SAMPLE_TIME
        torque = computed_torque(model, data, reference.at(t))
        torque = np.round(torque, 5)
        q = data.qpos + rng.normal(0, POSITION_NOISE, 6)
        dq = data.qvel + rng.normal(0, SPEED_NOISE, 6)
        rows.append(np.concatenate(([t], torque, q, dq)))
        data.qfrc_applied[:] = torque
        for _ in range(round(SAMPLE_TIME / STEP)):
            mujoco.mj_step(model, data)
    return np.array(rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=HERE / "data", help="folder to write to")
    folder = parser.parse_args().out
    names = [f"{name}{joint}" for name in ("tau", "q", "dq") for joint in range(1, 7)]
    for split, numbers in EPISODES.items():
        (folder / split).mkdir(parents=True, exist_ok=True)
        for number in numbers:
            file = folder / split / f"episode_{number:02}.csv"
            header = ",".join(("time", *names))
            np.savetxt(file, episode(number), fmt="%.7g", delimiter=",", header=header, comments="")
    print(f"wrote {sum(map(len, EPISODES.values()))} episodes to {folder}")


if __name__ == "__main__":
    main()
