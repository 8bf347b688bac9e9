"""Records the rig with a pump that jumps at random, both levels measured."""

from pathlib import Path

import numpy as np
from plant import SAMPLE_TIME, Tanks

SAMPLES = 400
FILES = {"train_0": 0, "train_1": 1, "train_2": 2, "validation": 3}  # by seed


def record(folder: Path) -> None:
    """Writes the files; the same ones every time."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, seed in FILES.items():
        random, rig, pump = np.random.default_rng(seed), Tanks(), 4.0
        lines = ["time,pump,upper,lower"]
        for sample in range(SAMPLES):
            if sample % 12 == 0:
                pump = float(random.uniform(1.0, 8.0))
            if rig.levels[0] > 10.0:
                pump = min(pump, 3.0)
            upper, lower = rig.measured(random)
            lines.append(f"{SAMPLE_TIME * sample:.0f},{pump:.4f},{upper:.4f},{lower:.4f}")
            rig.step(pump)
        (folder / f"{name}.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    record(Path(__file__).parent / "data")
