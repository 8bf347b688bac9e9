"""Measures how long `msnn compare` takes with the C of every structure counted.

    python benchmarks/identification/compare_variants.py [--cases variants structures] [--jobs 2]

`variants` are 200 of 40 structures (windows of a filter, each with five seeds), `structures` 200 of
as many. The first comparison begins with an empty folder of kernels. Prints seconds, and those of
all processes on a processor: half of these is what two idle cores need at least.
"""

from __future__ import annotations

import argparse
import ctypes
import os
import resource
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
ROWS = 2000
_SET_CHILD_SUBREAPER = 36
"""PR_SET_CHILD_SUBREAPER of linux/prctl.h."""
SPEC = """\
msnn: 1
name: heated_plate
doc: The temperature of a plate from the power of its heater, by two filters.
sample_time: 0.1 s
inputs: {T: degC, P: kW}
layers:
  own: {fir: {window: 2}}
  power: {fir: {window: 4}}
outputs:
  T_next: {expr: own(T) + power(P), predicts: "T[t+1]"}
data:
  source: {all: data.csv}
  split: {by: fraction, train: 0.7, val: 0.3}
train: [{epochs: 20, rollout: {horizon: 10, stride: 10}, optimizer: {adam: {lr: 0.01}}}]
validate: [{of: T_next, metric: fit, rollout: 10}]
"""
CASES = {
    "variants": ("--grid", f"layers.power.fir.window={','.join(map(str, range(1, 41)))}",
                 "--seeds", "5"),
    "structures": ("--grid", f"layers.power.fir.window={','.join(map(str, range(1, 41)))}",
                   "--grid", "layers.own.fir.window=1,2,3,4,5"),
}  # fmt: skip
"""What is compared: 200 trainings each."""


def main() -> None:
    """Measures, and prints one line per comparison."""
    parser = argparse.ArgumentParser(description="Seconds of a comparison of 200 trainings.")
    parser.add_argument("--cases", nargs="*", choices=CASES, default=list(CASES))
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--no-cost", action="store_true", help="do not count the C")
    chosen = parser.parse_args()
    for case in chosen.cases:
        with tempfile.TemporaryDirectory(prefix="msnn-compare-") as place:
            folder = Path(place)
            (folder / "plate.msnn.yaml").write_text(SPEC, encoding="utf-8")
            write_record(folder / "data.csv")
            arguments = [*CASES[case], "--jobs", str(chosen.jobs)]
            arguments += ["--no-cost"] if chosen.no_cost else []
            seconds, computed = measured(folder, arguments)
            print(
                f"{case}: 200 trainings in {seconds:.0f} s ({computed:.0f} s of processors, "
                f"{computed / chosen.jobs:.0f} s on {chosen.jobs} idle cores at least)",
                flush=True,
            )


def write_record(path: Path) -> None:
    """Writes a noisy recording of a plate with two heat capacities."""
    random = np.random.default_rng(16)
    power = np.repeat(random.uniform(0, 2, ROWS // 20 + 1), 20)[:ROWS]
    inner = outer = 20.0
    lines = ["T,P"]
    for k in range(ROWS):
        lines.append(f"{outer + random.normal(scale=0.02):.5g},{power[k]:.5g}")
        inner += 0.1 * (3 * power[k] - 0.5 * (inner - outer))
        outer += 0.1 * (0.5 * (inner - outer) - 0.3 * (outer - 20))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def adopt_orphans() -> None:
    """Makes this process the parent of processes whose own parent has ended, to count their time
    too.
    """
    if ctypes.CDLL(None, use_errno=True).prctl(_SET_CHILD_SUBREAPER, 1, 0, 0, 0):
        raise OSError(ctypes.get_errno(), "cannot adopt processes")


def measured(folder: Path, arguments: list[str]) -> tuple[float, float]:
    """Seconds of a comparison, and CPU seconds of it and of its child processes."""
    paths = {"PYTHONPATH": str(ROOT), "MSNN_CACHE": str(folder / "kernels")}
    command = [sys.executable, "-m", "msnn", "compare", "plate.msnn.yaml", *arguments]
    adopt_orphans()
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run(
        command, cwd=folder, env={**os.environ, **paths}, check=True, stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )  # fmt: skip
    seconds = time.perf_counter() - began
    with suppress(ChildProcessError):  # the server that forked the workers outlives the command
        while True:
            os.wait()
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    computed = after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime
    return seconds, computed


if __name__ == "__main__":
    main()
