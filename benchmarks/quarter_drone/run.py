"""Prints the table of a real drone arm: free-simulation error of models beside published figures.

    python benchmarks/quarter_drone/run.py --data FOLDER

The folder holds the records of helonayala/sysid, data/quarter_drone (public domain).
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from benchmarks.quarter_drone.protocol import PUBLISHED, RECORDS, SPECS, score

DATA = Path(__file__).resolve().parents[3] / "shared" / "data" / "quarter_drone"


def main() -> None:
    """Train every spec on every record and print one row a model."""
    parser = argparse.ArgumentParser(description="Score models of the quarter-drone rig.")
    parser.add_argument("--data", type=Path, default=DATA)
    data = parser.parse_args().data
    if not data.is_dir():
        print(f"no records in {data}: this benchmark needs --data FOLDER")
        return
    print("| model | " + " | ".join(RECORDS) + " | training |")
    print("|---|" + "---|" * (len(RECORDS) + 1))
    for model, figures in PUBLISHED.items():
        cells = " | ".join(f"{figures[name]:.3f}" for name in RECORDS)
        print(f"| {model} (published) | {cells} | |")
    for model, spec in SPECS.items():
        scores = []
        for file in RECORDS.values():
            with tempfile.TemporaryDirectory() as folder:
                scores.append(score(spec, data / file, Path(folder)))
        cells = " | ".join(f"{s.degrees:.3f}" for s in scores)
        seconds = max(s.training_seconds for s in scores)
        print(f"| msnn, {model} | {cells} | {seconds:.1f} s |", flush=True)


if __name__ == "__main__":
    main()
