"""Measures Levenberg and Marquardt over a long record of three states: seconds and memory.

    python benchmarks/identification/train_rows.py [--rows 1000000] [--epochs 10]

The system and its record are those of validate_rows.py. Four parameters are learned by rollouts of
a hundred samples; each command runs in a process of its own, twice: the first time with an empty
folder of kernels. Prints seconds, those of a processor, which do not depend on what else runs, and
the peak of resident memory.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from benchmarks.identification.validate_rows import SPEC, measured, write_record

STAGE = """\
train:
  - optimizer: levenberg_marquardt
    epochs: {epochs}
    rollout: {{horizon: 100, stride: 100}}
"""


def main() -> None:
    """Measures, and prints one line per training."""
    parser = argparse.ArgumentParser(description="Seconds and memory of training on a long record.")
    parser.add_argument("--rows", type=int, default=1_000_000)
    parser.add_argument("--epochs", type=int, default=10)
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="msnn-train-rows-") as place:
        folder = Path(place)
        text = SPEC.replace("source: {test: data.csv}", "source: {train: data.csv}")
        text += STAGE.format(epochs=chosen.epochs)
        (folder / "spring.msnn.yaml").write_text(text, encoding="utf-8")
        write_record(folder / "data.csv", chosen.rows)
        for times in ("first", "again"):
            seconds, computed, megabytes = measured(folder, ["train", "spring.msnn.yaml"])
            print(
                f"train, {times}: {chosen.rows} rows in {seconds:.1f} s "
                f"({computed:.1f} s of a processor), at most {megabytes:.0f} MB",
                flush=True,
            )


if __name__ == "__main__":
    main()
