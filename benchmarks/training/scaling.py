"""Measures how the time of an epoch grows with data, horizon, batch and threads, for workload b.

    python benchmarks/training/scaling.py    # the tables under Growth in RESULTS.md

The cases of a table take turns, so that other work on the machine affects all of them.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from statistics import median
from typing import Any

sys.path.insert(0, str(Path(__file__).parent / "contenders"))

import numpy as np
from machine import load, processor
from msnn_kernel import MsnnKernel
from workloads import WORKLOADS, Workload, log


@dataclass(frozen=True, slots=True)
class Case:
    """The sizes of one measurement: data, horizon, batch and threads."""

    windows: int = 15_000
    horizon: int = 51
    batch: int = 128
    threads: int = 1


TABLES: Mapping[str, Sequence[Case]] = {
    "windows": [Case(windows=n) for n in (3_750, 7_500, 15_000, 30_000, 60_000, 120_000)],
    "horizon": [Case(horizon=n) for n in (13, 26, 51, 102, 204, 408)],
    "batch": [Case(batch=n) for n in (16, 32, 64, 128, 512, 2048)],
    "threads": [Case(batch=b, threads=n) for b in (128, 512, 2048) for n in (1, 2)],
}
"""What changes in each table; the rest stays."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=7, help="timed rounds after the warm one")
    rounds = parser.parse_args().rounds
    before = load()
    parts = [_table(name, cases, rounds) for name, cases in TABLES.items()]
    when = f"{datetime.now(UTC):%Y-%m-%d %H:%M} UTC"
    print(f"Measured {when}, {processor()}, load {before:.1f} before and {load():.1f} after.\n")
    print("\n\n".join(parts))


def _table(name: str, cases: Sequence[Case], rounds: int) -> str:
    with tempfile.TemporaryDirectory() as folder:
        running = [_opened(case, Path(folder)) for case in cases]
        times: list[list[float]] = [[] for _ in cases]
        for number in range(rounds + 1):
            for kernel, found in zip(running, times, strict=True):
                seconds, _ = kernel.epochs(10, False)
                if number:
                    found.append(seconds / 10)
    columns = [name, "ms an epoch", "min … max", "ns a sample and step"]
    rows: list[list[str]] = []
    for case, found in zip(cases, times, strict=True):
        steps = _workload(case).whole(case.windows, case.batch) * case.horizon
        size = (
            f"{case.threads}, batch {case.batch}" if name == "threads" else f"{getattr(case, name)}"
        )
        middle = f"{median(found) * 1e3:.3f}"
        spread = f"{min(found) * 1e3:.3f} … {max(found) * 1e3:.3f}"
        row = [size, middle, spread, f"{median(found) / steps * 1e9:.2f}"]
        if name == "threads":
            alone = times[cases.index(replace(case, threads=1))]
            gains = [one / two for one, two in zip(alone, found, strict=True)]
            row.append(f"{median(gains):.2f} ({min(gains):.2f})")
        rows.append(row)
    if name == "threads":
        columns.append("times the speed of one thread (worst round)")
    lines = [columns, ["---"] * len(columns), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _workload(case: Case) -> Workload:
    return replace(WORKLOADS["b"], horizon=case.horizon)


def _opened(case: Case, folder: Path) -> MsnnKernel:
    workload = _workload(case)
    data = folder / f"log_{case.windows}.npz"
    if not data.exists():
        np.savez(data, **log(workload, case.windows))
    os.environ["MSNN_CACHE"] = str(folder)
    settings: dict[str, Any] = workload.settings(data, case.windows, case.batch)
    return MsnnKernel({**settings, "threads": case.threads})


if __name__ == "__main__":
    main()
