"""Simulate each system of the gallery and write one CSV file for each spec.

The records are short and without noise: they are there so that every spec can be trained, not to
be a benchmark.
"""

import argparse
from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Columns = dict[str, Array]

ROWS = 400
SEED = 20240301


def main() -> None:
    """Write `<name>.csv` for every spec into a folder, by default `data` beside this file."""
    parser = argparse.ArgumentParser(description="Simulate the records of the gallery.")
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "data")
    arguments = parser.parse_args()
    for number, (name, simulate) in enumerate(SYSTEMS.items()):
        write_columns(arguments.out / f"{name}.csv", simulate(np.random.default_rng(SEED + number)))
    print(f"wrote {len(SYSTEMS)} records of {ROWS} rows to {arguments.out}")


def reference(random: np.random.Generator) -> Columns:
    """A vehicle pushed by a filtered command against a drag that grows with its speed."""
    u = levels(random, -8.0, 8.0, 25)
    pushed = np.convolve(u, np.full(25, 0.04))[:ROWS]
    v = run(lambda v, k: v + 0.05 * (pushed[k] - 2.0 * np.tanh(0.08 * v)), 0.0)
    return {"u": u, "v": v}


def two_tanks(random: np.random.Generator) -> Columns:
    """Torricelli's law, 40 small steps for each sample."""
    pump = levels(random, 2.0, 8.0, 20)

    def sample(x: Array, k: int) -> Array:
        for _ in range(40):
            out = np.array([0.09, 0.08]) * np.sqrt(np.maximum(x, 0.0))
            x = x + 0.1 * np.array([0.045 * pump[k] - out[0], out[0] - out[1]])
        return x

    x = run(sample, np.array([4.0, 4.0]))
    return {"pump": pump, "upper": x[:, 0], "lower": x[:, 1]}


def cart_pole(random: np.random.Generator) -> Columns:
    """A hanging pendulum that its cart shakes."""
    force = levels(random, -4.0, 4.0, 15)

    def sample(x: Array, k: int) -> Array:
        for _ in range(20):
            angle, rate = x
            pull = 0.25 * np.sin(angle) * (0.45 * rate**2 + 9.81 * np.cos(angle))
            push = (force[k] + pull) / (1.0 + 0.25 * np.sin(angle) ** 2)
            turn = -(push * np.cos(angle) + 9.81 * np.sin(angle)) / 0.45 - 0.05 * rate
            x = x + 0.001 * np.array([rate + 0.001 * turn, turn])
        return x

    x = run(sample, np.array([0.3, 0.0]))
    return {"force": force, "angle": x[:, 0], "rate": x[:, 1]}


def quarter_car(random: np.random.Generator) -> Columns:
    """A wheel that follows a road of random steps, smoothed."""
    road = np.convolve(levels(random, -0.04, 0.04, 40), np.full(20, 0.05))[:ROWS]

    def sample(x: Array, k: int) -> Array:
        for _ in range(10):
            z, dz, w, dw = x
            slip = dw - dz
            load = 20000.0 * (w - z) + (800.0 if slip > 0 else 1700.0) * slip
            forces = np.array([dz, load / 350.0, dw, (180000.0 * (road[k] - w) - load) / 40.0])
            x = x + 0.0005 * forces
        return x

    x = run(sample, np.zeros(4))
    return {"road": road, "z": x[:, 0], "dz": x[:, 1], "w": x[:, 2], "dw": x[:, 3]}


def battery(random: np.random.Generator) -> Columns:
    """A cell of 2.5 Ah with one relaxation."""
    current, warmth = levels(random, -4.0, 9.0, 30), levels(random, 280.0, 310.0, 100)
    charge = 0.8 - np.concatenate([[0.0], np.cumsum(current)[:-1]]) / 9000.0
    relaxed = run(lambda x, k: 0.95 * x + 0.001 * current[k], 0.0)
    resistance = 0.025 * np.exp(1800.0 * (1 / warmth - 1 / 298.15))
    voltage = 3.4 + 0.8 * charge - resistance * current - relaxed
    return {"current": current, "warmth": warmth, "charge": charge, "voltage": voltage}


def engine_map(random: np.random.Generator) -> Columns:
    """A torque that rises with the throttle and falls off at both ends of the speed range."""
    speed, throttle = random.uniform(800.0, 6000.0, ROWS), random.uniform(0.0, 1.0, ROWS)
    best = 190.0 - 100.0 * ((speed - 3800.0) / 3000.0) ** 2
    return {"speed": speed, "throttle": throttle, "torque": best * np.sqrt(throttle) - 30.0}


def arm_friction(random: np.random.Generator) -> Columns:
    """Three joints with inertia, viscous and dry friction."""
    torque = np.stack([levels(random, -3.0, 3.0, 10) for _ in range(3)], axis=1)
    inertia = np.array([2.0, 1.0, 0.5])

    def sample(rate: Array, k: int) -> Array:
        friction = 0.4 * np.tanh(rate / 0.2) + 0.8 * rate
        return rate + 0.01 * (torque[k] - friction) / inertia

    rate = run(sample, np.zeros(3))
    joints = range(3)
    return {f"rate{j + 1}": rate[:, j] for j in joints} | {
        f"torque{j + 1}": torque[:, j] for j in joints
    }


def tyre(random: np.random.Generator) -> Columns:
    """Pacejka's formula with other coefficients than the spec begins with."""
    slip, load = random.uniform(-0.25, 0.25, ROWS), random.uniform(1.0, 7.0, ROWS)
    bent = 11.0 * np.tan(slip)
    bent = bent - 0.1 * (bent - np.arctan(bent))
    return {"slip": slip, "load": load, "force": load**0.85 * np.sin(1.5 * np.arctan(bent))}


def leg(random: np.random.Generator) -> Columns:
    """Exact inverse kinematics of two links of 0.3 m, and a body that sags with the distance."""
    forward, down = random.uniform(-0.25, 0.25, ROWS), random.uniform(0.25, 0.5, ROWS)
    distance = np.hypot(forward, down)
    knee = np.arccos((distance**2 - 0.18) / 0.18)
    hip = np.arctan2(forward, down) - np.arcsin(0.3 * np.sin(knee) / distance)
    sag = 0.02 * distance
    return {"forward": forward, "down": down, "hip": hip + sag, "knee": knee - sag}


def heater(random: np.random.Generator) -> Columns:
    """An oven of one heat capacity behind an element of another."""
    duty, wanted = levels(random, 0.0, 1.0, 30), levels(random, 50.0, 180.0, 100)

    def sample(x: Array, k: int) -> Array:
        element = 0.8 * x[0] + 0.2 * duty[k]
        return np.array([element, x[1] + 0.5 * (18.0 * x[0] - 0.06 * x[1])])

    oven = run(sample, np.array([0.0, 20.0]))[:, 1]
    return {"wanted": wanted, "duty": duty, "oven": oven}


def motor(random: np.random.Generator) -> Columns:
    """A DC motor in small steps, since its current settles within 0.2 ms."""
    voltage = levels(random, -12.0, 12.0, 25)

    def sample(x: Array, k: int) -> Array:
        for _ in range(200):
            current, speed = x
            fall = (voltage[k] - 1.1 * current - 0.05 * speed) / 0.0001
            turn = (0.05 * current - 0.002 * np.tanh(speed / 5.0)) / 0.00008
            x = x + 0.00005 * np.array([fall, turn])
        return x

    x = run(sample, np.zeros(2))
    return {"voltage": voltage, "current": x[:, 0], "speed": x[:, 1]}


def lane_keeper(random: np.random.Generator) -> Columns:
    """A driver who steers by the curvature a little ahead and by the offset, with some lag."""
    curvature = np.convolve(levels(random, -0.03, 0.03, 30), np.full(15, 1 / 15))[:ROWS]
    speed, offset = levels(random, 5.0, 35.0, 80), 0.5 * levels(random, -2.0, 2.0, 12)
    ahead = np.concatenate([curvature[4:], np.zeros(4)])
    wish = 2.7 * ahead - 0.02 * np.tanh(offset)
    steering = run(lambda x, k: 0.8 * x + 0.2 * wish[k], 0.0)
    return {"curvature": curvature, "speed": speed, "offset": offset, "steering": steering}


SYSTEMS: dict[str, Callable[[np.random.Generator], Columns]] = {
    system.__name__: system
    for system in (
        reference,
        two_tanks,
        cart_pole,
        quarter_car,
        battery,
        engine_map,
        arm_friction,
        tyre,
        leg,
        heater,
        lane_keeper,
        motor,
    )
}


def levels(random: np.random.Generator, low: float, high: float, held: int) -> Array:
    """Random levels, each held for about `held` samples."""
    count = ROWS // held + 2
    lengths = random.integers(held // 2 + 1, held + held // 2 + 1, count * 2)
    return np.repeat(random.uniform(low, high, count * 2), lengths)[:ROWS]


def run(sample: Callable[..., Array | float], start: Array | float) -> Array:
    """The states x[0] = start, x[k+1] = sample(x[k], k), one row each."""
    rows = [start]
    for k in range(ROWS - 1):
        rows.append(sample(rows[-1], k))
    return np.array(rows)


def write_columns(path: Path, columns: Columns) -> None:
    """Write a table under a temporary name, then rename it: no file is ever half written."""
    path.parent.mkdir(parents=True, exist_ok=True)
    rows = np.column_stack([*columns.values()])
    lines = [",".join(columns), *(",".join(f"{x:.9g}" for x in row) for row in rows)]
    unfinished = path.with_suffix(".unfinished")
    unfinished.write_text("\n".join(lines) + "\n", encoding="utf-8")
    unfinished.replace(path)


if __name__ == "__main__":
    main()
