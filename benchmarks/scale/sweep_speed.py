"""Measures trainings of a sweep a second: 200 draws of two first guesses by 5 folds.

    python benchmarks/scale/sweep_speed.py [--draws 200] [--jobs 2] [--lm | --adam] [--write]

The model is `examples/mass_spring_damper/msd_physical.msnn.yaml` as it stands (20 epochs of Adam, 2
of L-BFGS with 20 iterations each, 26 records of 151 rows to train on); with --adam the second stage
takes 20 epochs of Adam instead, so that kernels alone train. A first sweep of two draws makes the
kernels; CPU seconds are those of this process and its children, which a machine with other work to
do does not lengthen much. --write keeps the last two lines in RESULTS.md.
"""

from __future__ import annotations

import argparse
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from multiprocessing.forkserver import ForkServer, ensure_running
from pathlib import Path

from results import write_section

import msnn
from msnn.training.records.run_log import LOG

EXAMPLE = Path(__file__).parents[2] / "examples" / "mass_spring_damper"
SETTINGS = {
    "data.source": {"train": "data/train/*.csv"},
    "data.split": {"by": "kfold", "k": 5},
}
DRAW = {
    "parameters.mass.init": "uniform(0.5, 4) kg",
    "parameters.stiffness.init": "log(5, 40) N/m",
}


def main() -> None:
    """Makes the data, sweeps twice, and prints one line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=200)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--lm", action="store_true", help="Levenberg-Marquardt in both stages")
    parser.add_argument("--adam", action="store_true", help="no L-BFGS, which torch steps")
    parser.add_argument("--write", action="store_true", help="keep the figures")
    arguments = parser.parse_args()
    settings: dict[str, object] = dict(SETTINGS)
    if arguments.adam:
        settings |= {"train.1.optimizer": {"adam": {"lr": 0.01}}, "train.1.epochs": 20}
    if arguments.lm:
        settings |= {
            "train.0.optimizer": "levenberg_marquardt",
            "train.0.epochs": 3,
            "train.1.optimizer": "levenberg_marquardt",
            "train.1.epochs": 3,
        }
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        spec = Path(shutil.copy(EXAMPLE / "msd_physical.msnn.yaml", folder))
        generate = [sys.executable, str(EXAMPLE / "generate_data.py"), "--out", "data"]
        subprocess.run(generate, cwd=folder, check=True, stdout=subprocess.DEVNULL)
        for draws, seed in ((2, 1), (arguments.draws, 0)):
            began, before = time.monotonic(), cpu_seconds()
            found = msnn.sweep(
                spec,
                draw=DRAW,
                draws=draws,
                draw_seed=seed,
                settings=settings,
                folds=True,
                runs=folder / "runs",
                jobs=arguments.jobs,
            )
            wall, cpu = time.monotonic() - began, cpu_seconds() - before
            trained = sum(len(entry.lines) for entry in found.entries)
            line = (
                f"{trained} trainings in {wall:.1f} s: {trained / wall:.1f} a second, "
                f"{1e3 * cpu / trained:.1f} ms of CPU each (load {os.getloadavg()[0]:.1f})"
            )
            print(line)
        left = sizes(folder / "runs")
        print(left)
        if arguments.write:
            write_section(f"sweep_speed.py --draws {arguments.draws}", [line, left])


def sizes(runs: Path) -> str:
    """The size of the files of a training, and of its line in the log."""
    lines = (runs / LOG).read_bytes().splitlines()
    files = [path for path in runs.rglob("*") if path.is_file() and path.name != LOG]
    kept = sum(path.stat().st_size for path in files)
    trained, logged = len(lines), sum(map(len, lines))
    return (
        f"a training leaves {kept / trained / 1e3:.1f} kB in {len(files) / trained:.1f} files, "
        f"and {logged / trained / 1e3:.1f} kB in the log"
    )


def cpu_seconds() -> float:
    """CPU seconds of this process and of its ended children."""
    server = ensure_running.__self__  # nothing public ends it, and it counts when it has ended
    assert isinstance(server, ForkServer)
    vars(ForkServer)["_stop"](server)
    kinds = (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    used = [resource.getrusage(kind) for kind in kinds]
    return sum(each.ru_utime + each.ru_stime for each in used)


if __name__ == "__main__":
    main()
