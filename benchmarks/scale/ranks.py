"""Measures how much faster two processes train than one: `ranks.py FOLDER [--rows 10000000]`.

Generates the data below FOLDER and deletes them. Prints the median time of an epoch by the clock
and, as other work may share the cores, its processor seconds in each process: where every process
has a core of its own, an epoch takes as long as the busiest one of them. `--write` keeps it all
in RESULTS.md.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import statistics
import subprocess
import sys
import time
from itertools import pairwise
from pathlib import Path

import numpy as np
from results import write_section

SPEC = """
msnn: 1
name: plant
sample_time: 0.01 s
inputs: {{u: {{}}, x: {{}}}}
layers:
{layers}
outputs:
  y: {{expr: "{expression}", predicts: "x[t+1]"}}
data: {{source: {{train: train.npz, val: val.npz}}}}
train:
  - {{name: {stage}, epochs: 5, {keys}, rollout: {{horizon: 20, stride: 20}}, threads: 1}}
"""
SPECS = {
    "gradients": SPEC.format(
        stage="gradients",
        layers="  h: {fir: {window: 16}}\n  g: {fir: {window: 16}}\n  f: {mlp: {hidden: [16, 16]}}",
        expression="f(h(x), g(u))",
        keys="batch: 65536, optimizer: adam",
    ),
    "squares": SPEC.format(
        stage="squares",
        layers="  h: {fir: {window: 16}}\n  g: {fir: {window: 16}}",
        expression="tanh(h(x)) + g(u)",
        keys="optimizer: levenberg_marquardt",
    ),
}


def main() -> None:
    arguments = argparse.ArgumentParser()
    arguments.add_argument("folder", type=Path)
    arguments.add_argument("--rows", type=int, default=10_000_000)
    arguments.add_argument("--rounds", type=int, default=2)
    arguments.add_argument("--write", action="store_true")
    arguments.add_argument("--trains", action="store_true", help="Used by the script itself.")
    given = arguments.parse_args()
    if given.trains:
        train(given.folder)
        return
    folder = given.folder / "ranks"
    folder.mkdir(parents=True)
    try:
        said = measure(folder, given.rows, given.rounds)
    finally:
        shutil.rmtree(folder)
    if given.write:
        write_section(f"ranks.py FOLDER --rows {given.rows}", said)


def train(folder: Path) -> None:
    """Trains in one process; writes loss, time and CPU seconds after each epoch."""
    import msnn
    from msnn.training.records.progress import EpochEnd

    ranks = None
    if int(os.environ.get("WORLD_SIZE", "1")) > 1:
        from msnn.training.ranks.gloo_ranks import GlooRanks

        ranks = GlooRanks()
    lines: list[dict[str, float]] = []

    def ended(event: object) -> None:
        if isinstance(event, EpochEnd):
            now = {"cpu": time.process_time(), "clock": time.monotonic()}
            lines.append({"total": event.total, **now})

    msnn.train(msnn.load(folder / "plant.yaml"), runs=None, progress=ended, ranks=ranks)
    name = f"{1 if ranks is None else ranks.count}-{0 if ranks is None else ranks.rank}.json"
    (folder / name).write_text(json.dumps(lines))


def measure(folder: Path, rows: int, rounds: int) -> list[str]:
    """Trains each spec in one process and in two, alternately; returns lines of results."""
    said: list[str] = []
    generator = np.random.default_rng(0)
    for name, count in (("train", rows), ("val", 100_000)):
        u = generator.normal(size=count)
        x = 0.3 * np.concatenate(([0.0], u[:-1])) + 0.01 * generator.normal(size=count)
        np.savez(folder / f"{name}.npz", u=u, x=x)
    for _ in range(rounds):
        for stage, spec in SPECS.items():
            (folder / "plant.yaml").write_text(spec)
            one, two = run(folder, 1)[0], run(folder, 2)
            alone, shared = (epoch(lines, "clock") for lines in (one, two[0]))
            busy = [epoch(lines, "cpu") for lines in (one, *two)]
            off = max(abs(a["total"] / b["total"] - 1) for a, b in zip(one, two[0], strict=True))
            clock = f"clock {alone:.3f} s, {shared:.3f} s in two: {alone / shared:.2f} times"
            processor = (
                f"processor {busy[0]:.3f} s, {busy[1]:.3f} and {busy[2]:.3f} s in two: "
                f"{busy[0] / max(busy[1:]):.2f} times; losses differ by {off:.1e}"
            )
            said += [f"{stage}: {clock}", f"{stage}: {processor}"]
            print(*said[-2:], sep="\n", flush=True)
    return said


def run(folder: Path, ranks: int) -> list[list[dict[str, float]]]:
    """Trains with `ranks` processes; returns the lines that each wrote."""
    torchrun = ["-m", "torch.distributed.run", "--nproc-per-node", str(ranks)]
    words = [sys.executable, *(torchrun if ranks > 1 else []), __file__, str(folder), "--trains"]
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    found = subprocess.run(words, env=environment, check=False, capture_output=True, text=True)
    if found.returncode:
        sys.exit(found.stderr)
    return [json.loads((folder / f"{ranks}-{rank}.json").read_text()) for rank in range(ranks)]


def epoch(lines: list[dict[str, float]], what: str) -> float:
    """The median of a value over the epochs, which other work on the machine disturbs least."""
    times = [line[what] for line in lines]
    return statistics.median(b - a for a, b in pairwise(times))


if __name__ == "__main__":
    main()
