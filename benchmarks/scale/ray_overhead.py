"""Measures what Ray adds to a training: the driver's time, and a task's time around its work.

    python benchmarks/scale/ray_overhead.py [--draws 40]

The same sweep as `sweep_speed.py`, on Ray on this machine with one processor. *Driver*: CPU seconds
of this process a training, which is all that a sweep does in one place: models lowered, tasks sent,
results written. *Task*: wall seconds from one result to the next less those of the training
itself, on the one worker, once it is warm.
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
from pathlib import Path
from statistics import median

import ray
from sweep_speed import DRAW, EXAMPLE, SETTINGS

import msnn
from msnn.comparison import ray_workers
from msnn.comparison.trial import Outcome, ReadyTrial, Setup, Trial


@dataclass
class Clock:
    """Hears when trainings end."""

    ends: list[float] = field(default_factory=list)

    def began(self, trials: int) -> None:
        """Nothing has ended yet."""

    def ended(self, trial: Trial, outcome: Outcome) -> None:
        """Notes the time."""
        del trial, outcome
        self.ends.append(time.monotonic())


def timed(ready: ReadyTrial, setup: Setup) -> Outcome:
    """A task's own work, with its seconds as the reason of the line."""
    from dataclasses import replace

    began = time.perf_counter()
    outcome = trained(ready, setup)
    spent = time.perf_counter() - began
    return replace(outcome, line=replace(outcome.line, reason=f"{spent}"))


trained = ray_workers.train_ready


def in_task(*sent: object) -> object:
    """The task, with its work timed on the worker."""
    ray_workers.train_ready = timed
    return own_task(*sent)


own_task = ray_workers._in_task


def main() -> None:
    """Make the data, start Ray, sweep, print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=40)
    draws = parser.parse_args().draws
    here = {"env_vars": {"PYTHONPATH": str(Path(__file__).parent)}}
    ray.init("local", num_cpus=1, log_to_driver=False, runtime_env=here)
    ray_workers._in_task = in_task
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        spec = Path(shutil.copy(EXAMPLE / "msd_physical.msnn.yaml", folder))
        generate = [sys.executable, str(EXAMPLE / "generate_data.py"), "--out", "data"]
        subprocess.run(generate, cwd=folder, check=True, stdout=subprocess.DEVNULL)
        clock, before = Clock(), time.process_time()
        found = msnn.sweep(
            spec,
            draw=DRAW,
            draws=draws,
            settings=SETTINGS,
            folds=True,
            runs=folder / "runs",
            ray="local",
            listener=clock,
        )
        driver = time.process_time() - before
    spent = [float(line.reason) for entry in found.entries for line in entry.lines]
    gaps = [later - sooner for sooner, later in zip(clock.ends, clock.ends[1:], strict=False)]
    print(
        f"{len(spent)} trainings: driver {1e3 * driver / len(spent):.1f} ms of CPU each; "
        f"median work {1e3 * median(spent):.1f} ms, median between results "
        f"{1e3 * median(gaps):.1f} ms (load {os.getloadavg()[0]:.1f})"
    )


if __name__ == "__main__":
    main()
