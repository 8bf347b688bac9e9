"""Measures how long `msnn validate` and `msnn simulate` take over a long record, and their memory.

    python benchmarks/identification/validate_rows.py [--rows 1000000] [--engines native]

A record of three measured states is simulated freely from its first row to its last. Each command
runs in a process of its own, twice: the first time with an empty folder of kernels. Prints seconds,
those of a processor, which do not depend on what else runs, and the peak of resident memory.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
SAMPLE_TIME = 0.01
SPEC = """\
msnn: 1
name: hardening_spring
doc: "A mass on a hardening spring with a creeping damper: three states, all of them measured."
sample_time: 0.01 s
inputs:
  F: N
parameters:
  mass: {init: 1, unit: kg, learn: false}
  stiffness: {init: 40, unit: N/m}
  hardening: {init: 30, unit: N/m^3}
  damping: {init: 1.5, unit: N*s/m}
  creep: {init: 8, unit: N/m}
  tau: {init: 0.5, unit: s, learn: false}
states:
  x: {unit: m, der: v, init: x.meas}
  v: {unit: m/s, der: (F - stiffness*x - hardening*x**3 - damping*v - creep*z) / mass, init: v.meas}
  z: {unit: m, der: v - z/tau, init: z.meas}
outputs:
  x_next: {expr: next(x), predicts: "x[t+1]"}
  v_next: {expr: next(v), predicts: "v[t+1]"}
  z_next: {expr: next(z), predicts: "z[t+1]"}
data:
  source: {test: data.csv}
validate:
  - {of: x_next, metric: fit, rollout: record}
  - {of: v_next, metric: fit, rollout: record}
  - {of: z_next, metric: fit, rollout: record}
"""


def main() -> None:
    """Measures, and prints one line per command."""
    parser = argparse.ArgumentParser(description="Seconds and memory of a long record.")
    parser.add_argument("--rows", type=int, default=1_000_000)
    parser.add_argument("--engines", nargs="*", default=["native", "interpreter"])
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="msnn-validate-rows-") as place:
        folder = Path(place)
        (folder / "spring.msnn.yaml").write_text(SPEC, encoding="utf-8")
        write_record(folder / "data.csv", chosen.rows)
        for engine in chosen.engines:
            for verb in ("validate", "simulate"):
                for times in ("first", "again"):
                    command = [verb, "spring.msnn.yaml", "--initial", "--engine", engine]
                    command += ["--out", "simulation.csv"] if verb == "simulate" else []
                    seconds, computed, megabytes = measured(folder, command)
                    print(
                        f"{verb} --engine {engine}, {times}: {chosen.rows} rows in {seconds:.1f} s "
                        f"({computed:.1f} s of a processor), at most {megabytes:.0f} MB",
                        flush=True,
                    )
                    if engine == "interpreter":
                        break


def write_record(path: Path, rows: int) -> None:
    """Writes a simulated recording; its coefficients differ from the spec's, and its force has
    random steps.
    """
    random = np.random.default_rng(16)
    force = np.repeat(random.uniform(-20, 20, rows // 50 + 1), 50)[:rows]
    x = v = z = 0.0
    states = np.empty((rows, 3))
    for k in range(rows):
        states[k] = x, v, z
        for _ in range(2):
            v += SAMPLE_TIME / 2 * (force[k] - 41 * x - 28 * x**3 - 1.4 * v - 8.2 * z)
            z += SAMPLE_TIME / 2 * (v - z / 0.5)
            x += SAMPLE_TIME / 2 * v
    with path.open("w", encoding="utf-8") as file:
        file.write("F,x,v,z\n")
        np.savetxt(file, np.column_stack([force, states]), fmt="%.6g", delimiter=",")


def measured(folder: Path, arguments: list[str]) -> tuple[float, float, float]:
    """Seconds, CPU seconds, and the peak of memory in MB of one command."""
    command = [sys.executable, "-m", "msnn", *arguments]
    paths = {"PYTHONPATH": str(ROOT), "MSNN_CACHE": str(folder / "kernels")}
    began = time.perf_counter()
    process = subprocess.Popen(
        command, cwd=folder, env={**os.environ, **paths}, stdout=subprocess.DEVNULL
    )
    _, status, usage = os.wait4(process.pid, 0)
    seconds = time.perf_counter() - began
    assert os.waitstatus_to_exitcode(status) == 0, command
    return seconds, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024


if __name__ == "__main__":
    main()
