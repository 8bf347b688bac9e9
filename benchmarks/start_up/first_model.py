"""Walks the path of README by the clock: clone, install, a CSV file of one's own, C that runs.

    python benchmarks/start_up/first_model.py [--write]

Without extras, in an environment of its own, by pip as README says. The file is what a logger
might have written: blanks in names, units in brackets, decimal commas, times in steps of 0.1 s.
Downloads come from where pip takes them, its cache included. `--write` writes FIRST_MODEL.md.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[2]
ROWS = 3000
_BLOCK = 512
"""Bytes of a block, by POSIX."""
_TEXT = """\
# From a clone to C of one's own record

Written by `python benchmarks/start_up/first_model.py --write` with Python {python}, on a machine
with {cores} cores of which {load:.1f} processes were waiting or running (its load over the minute
at the end) while this ran with niceness {nice}. The record has {rows} rows.

| step | processor, s | clock, s |
|---|---|---|
{steps}
| in all | {processor:.1f} | {clock:.1f} |

The installation takes {size:.0f} MB on the disk.
"""


@dataclass(frozen=True)
class Step:
    """A step that a user takes, with its CPU seconds and its seconds by the clock."""

    name: str
    processor: float
    clock: float

    @property
    def row(self) -> str:
        """The row of the step in the table."""
        return f"| {self.name} | {self.processor:.1f} | {self.clock:.1f} |"


def main() -> int:
    """Prints the page; any step that fails ends it."""
    parser = argparse.ArgumentParser(description="Walks the path of README by the clock.")
    parser.add_argument("--write", action="store_true")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "oven.csv").write_text(record(), encoding="utf-8")
        page = walk(folder)
    print(page)
    if given.write:
        Path(__file__).with_name("FIRST_MODEL.md").write_text(page, encoding="utf-8")
    return 0


def record() -> str:
    """A CSV text: a first-order system with dead time, driven by steps, measured with noise."""
    random = np.random.default_rng(7)
    power = np.repeat(random.uniform(0, 200, ROWS // 50), 50)
    heat = np.zeros(ROWS)
    for row in range(5, ROWS):
        heat[row] = 0.98 * heat[row - 1] + 0.02 * 0.4 * power[row - 5]
    measured = 20 + heat + 0.05 * random.standard_normal(ROWS)
    rows = (f"{k / 10:.1f};{power[k]:.1f};{measured[k]:.2f}" for k in range(ROWS))
    return "\n".join(["time [s];heater power [W];oven temp [°C]", *rows, ""]).replace(".", ",")


def walk(folder: Path) -> str:
    """Takes every step in a folder; returns the page with the results."""
    clone, binaries = folder / "msnn", folder / "environment" / "bin"
    steps: list[Step] = []

    def does(name: str, *commands: list[str | Path], place: Path = folder) -> str:
        began, spent = time.perf_counter(), _spent()
        said = "".join(_run(command, folder, place) for command in commands)
        step = Step(name, _spent() - spent, time.perf_counter() - began)
        print(step.row, file=sys.stderr, flush=True)
        steps.append(step)
        return said

    msnn = binaries / "msnn"
    does("`git clone`", ["git", "clone", "--quiet", ROOT, clone])
    does("`python -m venv`", [sys.executable, "-m", "venv", folder / "environment"])
    before = _size(folder / "environment")
    does("`pip install`", [binaries / "pip", "install", "--quiet", clone])
    size = _size(folder / "environment") - before
    init: list[str | Path] = [msnn, "init", "oven", "--data", "oven.csv"]
    does("`msnn init --data`", [*init, "--predict", "oven temp [°C]"])
    home = folder / "oven"
    does("`msnn train`", [msnn, "train", "oven.msnn.yaml"], place=home)
    does("`msnn validate`", [msnn, "validate", "oven.msnn.yaml"], place=home)
    does("`msnn export --to c`", [msnn, "export", "oven.msnn.yaml", "--to", "c"], place=home)
    exported = home / "build" / "export" / "c"
    text = (exported / "README.md").read_text(encoding="utf-8")
    (exported / "main.c").write_text(text.split("```c\n")[1].split("```")[0], encoding="utf-8")
    compiler = next(line for line in text.splitlines() if line.startswith("    cc ")).split()
    said = does("`cc` and a run of `main.c`", [*compiler], ["./a.out"], place=exported)
    assert said.count("status 0 ") == 10, said
    return _TEXT.format(
        python=".".join(map(str, sys.version_info[:2])),
        cores=os.cpu_count(),
        load=os.getloadavg()[0],
        nice=os.nice(0),
        rows=ROWS,
        steps="\n".join(step.row for step in steps),
        processor=sum(step.processor for step in steps),
        clock=sum(step.clock for step in steps),
        size=1e-6 * size,
    )


def _run(command: list[str | Path], home: Path, place: Path) -> str:
    """The output of a command that has no caches of earlier commands."""
    own = {"HOME": str(home), "MSNN_CACHE": str(home / "cache")}
    done = subprocess.run(
        command, cwd=place, env={**os.environ, **own}, capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise SystemExit(f"{command}\n{done.stdout}{done.stderr}")
    return done.stdout


def _spent() -> float:
    """CPU seconds of all child processes that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _size(folder: Path) -> int:
    """Bytes on the disk, as `du` counts them."""
    return sum(file.lstat().st_blocks * _BLOCK for file in folder.rglob("*"))


if __name__ == "__main__":
    sys.exit(main())
