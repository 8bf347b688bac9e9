"""Writes the records of the sample repository: a heated plate and a motor, measured with noise."""

from __future__ import annotations

from pathlib import Path

import numpy as np

FOLDER = Path(__file__).parent / "records"
_ROWS = 160


def write_records() -> None:
    """Two records to train on and one to test on of each, always the same ones."""
    random = np.random.Generator(np.random.Philox(18))
    for name in ("train_1", "train_2", "test"):
        power = _steps(random, 0.0, 200.0)
        # 80 J/K, 1.5 W/K
        _write(f"heater/{name}", "time,P,T", 1.0, power, 1 / 1.5, 80 / 1.5, random, 0.1)
        voltage = _steps(random, -12.0, 12.0)
        _write(f"motor/{name}", "time,u,w", 0.02, voltage, 14.0, 0.12, random, 0.4)


def _steps(random: np.random.Generator, low: float, high: float) -> np.ndarray:
    levels = random.uniform(low, high, _ROWS // 10)
    return np.repeat(np.round(levels, 2), 10)


def _write(
    name: str,
    header: str,
    sample_time: float,
    drive: np.ndarray,
    gain: float,
    tau: float,
    random: np.random.Generator,
    noise: float,
) -> None:
    """τ·ẏ = gain·u − y from rest, exact between rows since u is held."""
    decay, value, lines = np.exp(-sample_time / tau), 0.0, [header]
    for row, given in enumerate(drive):
        measured = value + random.normal(0.0, noise)
        lines.append(f"{row * sample_time:.2f},{given:.2f},{measured:.3f}")
        value = gain * given + (value - gain * given) * decay
    file = FOLDER / f"{name}.csv"
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text("\n".join([*lines, ""]), encoding="utf-8")


if __name__ == "__main__":
    write_records()
