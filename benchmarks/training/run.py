"""Trains small models with msnn and with its peers, side by side, and tells the times.

    python benchmarks/training/run.py                              # all: the figures of RESULTS.md
    python benchmarks/training/run.py --windows 1000 --rounds 1 b  # a quick look

Every tool is a process that stays alive; rounds are interleaved on one core, the first is thrown
away, and ratios are those of times of the same round. A peer's environment is made with pip when it
is first needed, in the folder that MSNN_PEERS names.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from agreement import agreement
from machine import fma_peak, load, processor, stay_on_one_core
from report import Measured, markdown
from worker import JAX, KERNEL, NATIVE, NEUROMANCER, PEER, TOOLS, TORCH, Worker, open_workers
from workloads import WORKLOADS, log

CASES = {"a": 128, "b": 128, "c": 128, "b32": 32, "d16": 16, "d64": 64}
"""Workloads and batch sizes."""

WRITTEN_BY_HAND = "abc"
"""Workloads that have a program in JAX and in torch; the others compare msnn with its peer."""

PAIR = (PEER, NATIVE, KERNEL, TORCH)


def main() -> int:
    options = _options()
    if options.processor:
        os.environ["MSNN_BENCHMARK_CLOCK"] = "processor"
    stay_on_one_core()
    peak = fma_peak()
    found = [_measured(case, options) for case in options.cases]
    command = " ".join(["python", "benchmarks/training/run.py", *sys.argv[1:]])
    when = f"{datetime.now(UTC):%Y-%m-%d %H:%M} UTC"
    print(markdown(found, peak, f"{when}, {processor()}, `{command}`"))
    alike = all(
        measured.agreement.holds_with(tool)
        for measured in found
        for tool in (KERNEL, PEER, JAX, NEUROMANCER)
    )
    return 0 if alike else 1


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("cases", nargs="*", default=list(CASES), help=" ".join(CASES))
    parser.add_argument("--windows", type=int, default=15_000)
    parser.add_argument("--rounds", type=int, default=5, help="timed rounds after the warm one")
    parser.add_argument("--tools", nargs="*", default=list(TOOLS))
    parser.add_argument("--processor", action="store_true", help="seconds of processors, not wall")
    return parser.parse_args()


def _measured(case: str, options: argparse.Namespace) -> Measured:
    """Measures all tools for one workload at one batch size."""
    workload, batch = WORKLOADS[case[0]], CASES[case]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        data = folder / "log.npz"
        np.savez(data, **log(workload, options.windows))
        settings = workload.settings(data, options.windows, batch)
        os.environ["MSNN_CACHE"] = str(folder)  # each run builds its kernels
        tools = [tool for tool in options.tools if _has_program(tool, case[0])]
        workers = open_workers(tools, settings, folder)
        agreed = agreement(workers, settings)
        before = load()
        times = _rounds(case, workers, options.rounds)
        after = load()
        builds = {name: worker.build_seconds for name, worker in workers.items()}
        for worker in workers.values():
            worker.close()
    steps = workload.whole(options.windows, batch) * workload.horizon
    loads = (before, after)
    processor = options.processor
    return Measured(case, workload, batch, steps, times, builds, agreed, loads, processor)


def _has_program(tool: str, letter: str) -> bool:
    """True if a tool has the workload: NeuroMANCER has only the mass, the others all that are
    written by hand.
    """
    return tool in PAIR or letter in ("ab" if tool == NEUROMANCER else WRITTEN_BY_HAND)


def _rounds(case: str, workers: dict[str, Worker], rounds: int) -> dict[str, list[float]]:
    """Seconds per epoch of each tool in each round, without the first round, which warms up."""
    times: dict[str, list[float]] = {name: [] for name in workers}
    for number in range(rounds + 1):
        for name, worker in workers.items():
            seconds, _ = worker.epochs(worker.tool.epochs_a_round)
            if number:
                times[name].append(seconds)
            print(f"{case} round {number}: {name} {seconds:.6f} s", file=sys.stderr, flush=True)
    return times


if __name__ == "__main__":
    sys.exit(main())
