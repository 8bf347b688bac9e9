"""Measures what `msnn data` takes on a record of a million rows of three signals.

    python benchmarks/data/large_record.py [--write]    # writes RESULTS.md

Processor time and memory are those of the command, imports included.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[2]
ROWS = 1_000_000
SPEC = """\
msnn: 1
name: oven
sample_time: 0.1 s
inputs: {power: W, air: K, heat: K}
layers: {f: {fir: {window: 3}}, g: {fir: {window: 3}}, h: {fir: {window: 3}}}
outputs: {next: {expr: f(heat) + g(power) + h(air), predicts: "heat[t+1]"}}
data:
  source: {all: log.csv}
  columns: {power: power, air: air, heat: heat}
"""
_TEXT = """\
# Looking at a large record

Written by `python benchmarks/data/large_record.py --write`: `msnn data` on {rows:,} rows of three
signals, a file of {size:.0f} MB. It takes {processor:.1f} s of the processor and
{memory:.0f} MB of memory.
"""


def main() -> None:
    """Measures, and prints time and memory."""
    parser = argparse.ArgumentParser(description="Measures `msnn data`.")
    parser.add_argument("--write", action="store_true")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "oven.msnn.yaml").write_text(SPEC, encoding="utf-8")
        record(folder / "log.csv")
        size = (folder / "log.csv").stat().st_size
        processor, memory = taken(["data", "oven.msnn.yaml"], folder)
    page = _TEXT.format(rows=ROWS, size=1e-6 * size, processor=processor, memory=1e-6 * memory)
    print(page)
    if given.write:
        Path(__file__).with_name("RESULTS.md").write_text(page, encoding="utf-8")


def record(file: Path) -> None:
    """Writes a recording of a first-order system, driven by steps and a slow wave, with noise."""
    random = np.random.default_rng(3)
    power = np.repeat(random.uniform(0, 200, ROWS // 100), 100)
    air = 290 + 3 * np.sin(np.arange(ROWS) / 5000) + 0.2 * random.standard_normal(ROWS)
    heat = np.empty(ROWS)
    now = 290.0
    for row in range(ROWS):
        heat[row] = now
        now += 0.01 * (air[row] - now) + 0.004 * power[row]
    heat += 0.05 * random.standard_normal(ROWS)
    rows = np.column_stack((power, air, heat))
    np.savetxt(file, rows, fmt="%.4f", delimiter=",", header="power,air,heat", comments="")


def taken(words: list[str], folder: Path) -> tuple[float, int]:
    """CPU seconds and the peak of memory in bytes of a command of msnn."""
    command = [sys.executable, "-c", "from msnn.cli.main import main; main()", *words]
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1"}
    process = subprocess.Popen(
        command, cwd=folder, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    assert process.returncode == 0, words
    return used.ru_utime + used.ru_stime, 1024 * used.ru_maxrss


if __name__ == "__main__":
    main()
