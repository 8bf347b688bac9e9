"""Lets the arm follow a reference in MuJoCo by computed torque, without and with learned friction.

The friction is added at the measured position and the wanted speed, so that it does not answer to
the noise of the sensors. The references are those of the test episodes; the errors are kept in
`runs/tracking.json`.

    python control.py [--weights runs/z1_friction/latest/weights.safetensors]
"""

from __future__ import annotations

import argparse
from pathlib import Path

import mujoco
import numpy as np
import results
import truth
from evaluate import HERE, Friction, learned
from generate_data import EPISODES, SAMPLE_TIME, SAMPLES, STEP, Reference, arm, computed_torque


def tracking_error(friction: Friction) -> float:
    """The root mean square of wanted minus true positions, over joints and test episodes."""
    squares: list[float] = []
    for number in EPISODES["test"]:
        model, reference = arm(), Reference(number)
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:], _ = reference.at(0.0)
        mujoco.mj_forward(model, data)
        for index in range(SAMPLES):
            wanted = reference.at(index * SAMPLE_TIME)
            squares.append(float(np.mean((wanted[0] - data.qpos) ** 2)))
            added = friction(data.qpos[None], wanted[1][None])[0]
            data.qfrc_applied[:] = computed_torque(model, data, wanted) + added
            for _ in range(round(SAMPLE_TIME / STEP)):
                mujoco.mj_step(model, data)
    return float(np.sqrt(np.mean(squares)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    default = HERE / "runs" / "z1_friction" / "latest" / "weights.safetensors"
    parser.add_argument("--weights", type=Path, default=default)
    friction = learned(parser.parse_args().weights)
    models: dict[str, Friction] = {
        "none": lambda q, dq: 0 * q,
        "learned": friction,
        "true": truth.friction,
    }
    kept: dict[str, float] = {}
    for name, added in models.items():
        kept[name] = 1000 * tracking_error(added)
        print(f"tracking error with friction: {name:8} {kept[name]:7.2f} mrad")
    results.keep("tracking", kept)


if __name__ == "__main__":
    main()
