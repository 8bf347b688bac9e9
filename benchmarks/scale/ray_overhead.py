"""Measures what Ray adds to a training: one worker of Ray beside this process alone.

    python benchmarks/scale/ray_overhead.py [--draws 30]

The sweep of `sweep_speed.py`, of which one draw is trained first. Figures are medians of the
seconds from one result to the next, and CPU seconds of the driver from the first to the last: all
that a sweep on a cluster does in one place, without start-up and the first reading of data.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from statistics import median

import ray
from sweep_speed import DRAW, EXAMPLE, SETTINGS

import msnn
from msnn.comparison.trial import Outcome, Trial


@dataclass
class Clock:
    """Hears when trainings end."""

    ends: list[float] = field(default_factory=list)
    used: list[float] = field(default_factory=list)

    def began(self, trials: int) -> None:
        """Nothing has ended yet."""

    def ended(self, trial: Trial, outcome: Outcome) -> None:
        """Notes the time."""
        del trial, outcome
        self.ends.append(time.monotonic())
        self.used.append(time.process_time())


def main() -> None:
    """Make the data, start Ray, sweep, print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=40)
    draws = parser.parse_args().draws
    ray.init("local", num_cpus=1, log_to_driver=False)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        spec = Path(shutil.copy(EXAMPLE / "msd_physical.msnn.yaml", folder))
        generate = [sys.executable, str(EXAMPLE / "generate_data.py"), "--out", "data"]
        subprocess.run(generate, cwd=folder, check=True, stdout=subprocess.DEVNULL)
        for seed in (1, 2):
            for address in (None, "local"):
                gap, cpu = measured(spec, address, draws, seed)
                where = "this process" if address is None else "a worker of Ray"
                print(
                    f"{where}: {1e3 * gap:.1f} ms from result to result, {1e3 * cpu:.1f} ms of "
                    f"CPU each in this process (load {os.getloadavg()[0]:.1f})"
                )


def measured(spec: Path, address: str | None, draws: int, seed: int) -> tuple[float, float]:
    """The median of seconds between two results, and CPU seconds of this process for each."""
    clock = Clock()
    msnn.sweep(
        spec,
        draw=DRAW,
        draws=draws,
        draw_seed=seed,
        settings=SETTINGS,
        folds=True,
        runs=spec.parent / f"{address}",
        ray=address,
        listener=clock,
    )
    gaps = [later - sooner for sooner, later in pairwise(clock.ends)]
    return median(gaps), (clock.used[-1] - clock.used[0]) / len(gaps)


if __name__ == "__main__":
    main()
