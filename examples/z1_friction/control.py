"""Lets the arm follow a reference in MuJoCo by computed torque, without and with learned friction.

The controller reads positions and speeds, once exactly and once with the noise of the sensors that
`generate_data.py` gives the data (the setting has no quantisation), and computes mass matrix and
bias torques there. The friction is added at the read position and the wanted speed, so that it does
not answer to noise in the speed, around 0 of which it is steep. The references are those of the
test episodes; the errors are kept in `runs/tracking.json`.

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
from generate_data import (
    EPISODES,
    POSITION_NOISE,
    SAMPLE_TIME,
    SAMPLES,
    SPEED_NOISE,
    STEP,
    Reference,
    arm,
    computed_torque,
)


def tracking_error(friction: Friction, *, noisy: bool) -> float:
    """The root mean square of wanted minus true positions, over joints and test episodes."""
    squares: list[float] = []
    for number in EPISODES["test"]:
        model, reference, rng = arm(), Reference(number), np.random.default_rng(number)
        data, read = mujoco.MjData(model), mujoco.MjData(model)
        data.qpos[:], data.qvel[:], _ = reference.at(0.0)
        for index in range(SAMPLES):
            wanted = reference.at(index * SAMPLE_TIME)
            squares.append(float(np.mean((wanted[0] - data.qpos) ** 2)))
            noise = rng.normal(0, 1.0 if noisy else 0.0, (2, 6))
            read.qpos[:] = data.qpos + POSITION_NOISE * noise[0]
            read.qvel[:] = data.qvel + SPEED_NOISE * noise[1]
            mujoco.mj_forward(model, read)
            added = friction(read.qpos[None], wanted[1][None])[0]
            data.qfrc_applied[:] = computed_torque(model, read, wanted) + added
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
    kept: dict[str, dict[str, float]] = {}
    print("tracking error, mrad    exact states    noisy sensors")
    for name, added in models.items():
        exact, noisy = (1000 * tracking_error(added, noisy=noisy) for noisy in (False, True))
        kept[name] = {"exact": exact, "noisy": noisy}
        print(f"friction: {name:12} {exact:13.2f} {noisy:16.2f}")
    results.keep("tracking", kept)


if __name__ == "__main__":
    main()
