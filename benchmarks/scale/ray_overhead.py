"""Measures what Ray adds to a training: one worker of Ray beside this process alone.

    python benchmarks/scale/ray_overhead.py [--draws 30] [--rounds 5] [--write]

The sweep of `sweep_speed.py`, of which one draw is trained first, by turns in this process and on
one worker of Ray. What Ray adds is counted in CPU seconds from the first result to the last, which
other work does not lengthen much: those of this process (models, sending, files) and of the worker
(opening models, training, reading files back), less those of this process where it trains alone.
Ray's own servers are listed apart: they use as much when nothing is to be done. What else runs
changes the memory and the cores that a training finds, by more than Ray adds: the last line has the
median of the rounds. --write keeps the lines in RESULTS.md.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import Any

import ray
from results import write_section
from sweep_speed import DRAW, EXAMPLE, SETTINGS

import msnn
from msnn.features.comparison.trial import Trial, TrialOutcome

_TICKS = os.sysconf("SC_CLK_TCK")


@dataclass
class Clock:
    """A receiver of events that notes when trainings end."""

    ends: list[float] = field(default_factory=list[float])
    used: list[Mapping[str, float]] = field(default_factory=list[Mapping[str, float]])
    trials: int = 0

    def began(self, trials: int) -> None:
        """Resets the times at the beginning of a sweep."""
        self.trials = trials

    def ended(self, trial: Trial, outcome: TrialOutcome) -> None:
        """Notes the time."""
        del trial, outcome
        self.ends.append(time.monotonic())
        if len(self.ends) in (1, self.trials):  # to look at all processes takes a while
            self.used.append(cpu_seconds())

    def each(self, who: str) -> float:
        """Milliseconds of CPU time per training between the first and the last result."""
        begin, end = self.used[0], self.used[-1]
        used = end.get(who, 0.0) - begin.get(who, 0.0)
        return 1e3 * used / (len(self.ends) - 1)


def main() -> None:
    """Makes the data, starts Ray, sweeps, and prints the results."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=30)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--write", action="store_true", help="keep the figures")
    given = parser.parse_args()
    cluster: Any = ray
    cluster.init("local", num_cpus=1, log_to_driver=False)
    lines: list[str] = []
    gaps: list[float] = []
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        spec = Path(shutil.copy(EXAMPLE / "msd_physical.msnn.yaml", folder))
        generate = [sys.executable, str(EXAMPLE / "generate_data.py"), "--out", "data"]
        subprocess.run(generate, cwd=folder, check=True, stdout=subprocess.DEVNULL)
        for seed in range(1, given.rounds + 1):
            for address in (None, "local"):  # each knows kernels and imports from one draw
                measured(spec, address, 1, 100 + seed)
            alone, there = (measured(spec, where, given.draws, seed) for where in (None, "local"))
            added = there.each("this process") + there.each("worker") - alone.each("this process")
            gaps.append(added)
            lines += [
                f"alone: {alone.each('this process'):.1f} ms of CPU a training",
                f"on Ray: {there.each('this process'):.1f} ms in this process",
                f"on Ray: {there.each('worker'):.1f} ms in the worker, so {added:.1f} ms more",
                f"on Ray: {there.each('servers'):.1f} ms in Ray's servers",
                f"by the clock: {gap(alone):.1f} ms alone, {gap(there):.1f} ms on Ray",
            ]
            print(*lines[-5:], sep="\n", flush=True)
    lines.append(f"in the median of {given.rounds} rounds {median(gaps):.1f} ms more")
    print(lines[-1])
    if given.write:
        write_section(f"ray_overhead.py --draws {given.draws}", lines)


def measured(spec: Path, address: str | None, draws: int, seed: int) -> Clock:
    """Runs a sweep; returns the times at which trainings ended, and CPU times."""
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
    return clock


def gap(clock: Clock) -> float:
    """Milliseconds per training, averaged over five, because results of a cluster arrive in
    groups.
    """
    groups = clock.ends[::5]
    return 1e3 * median(later - sooner for sooner, later in pairwise(groups)) / 5


def cpu_seconds() -> dict[str, float]:
    """CPU seconds of this process, of Ray's workers, and of Ray's servers."""
    used = {"this process": time.process_time(), "worker": 0.0, "servers": 0.0}
    parents = {process: _parent(process) for process in _processes()}
    for process in parents:
        above = process
        while above in parents and above != os.getpid():
            above = parents[above]
        if above == os.getpid() != process:
            name = Path(f"/proc/{process}/cmdline").read_bytes()[:40]
            who = "worker" if name.startswith(b"ray::") else "servers"
            used[who] += _seconds(process)
    return used


def _processes() -> list[int]:
    return [int(place.name) for place in Path("/proc").iterdir() if place.name.isdecimal()]


def _fields(process: int) -> list[str]:
    try:
        text = Path(f"/proc/{process}/stat").read_text()
    except OSError:
        return []
    return text.rpartition(")")[2].split()


def _parent(process: int) -> int:
    found = _fields(process)
    return int(found[1]) if found else 0


def _seconds(process: int) -> float:
    found = _fields(process)
    return (int(found[11]) + int(found[12])) / _TICKS if found else 0.0


if __name__ == "__main__":
    main()
