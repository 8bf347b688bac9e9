"""Trains on more rows than memory holds: `rows_on_disk.py FOLDER [--rows 100000000]`.

Writes a partitioned Parquet data set below FOLDER, a vehicle a folder, trains on it in a process of
its own and deletes all of it. Prints the peak of that process's memory: its own (`RssAnon`), and
with the pages of files that it has mapped (`VmHWM`), which the system takes back when others want
memory. `--limit` bounds what is not such pages (`RLIMIT_DATA`), so that more would be an error.
`--write` keeps all that in RESULTS.md.
"""

from __future__ import annotations

import argparse
import os
import resource
import shutil
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
from results import write_section

SPEC = """
msnn: 1
name: fleet
sample_time: 0.01 s
inputs: {u: {}, x: {}}
layers:
  h: {fir: {window: 8}}
  n: {normalize: {mean: data, std: data}}
  g: {fir: {window: 8}}
outputs:
  y: {expr: "tanh(h(x)) + g(n(u))", predicts: "x[t+1]"}
data:
  source: {train: train, val: val}
  records: row_group
  keep: disk
train:
  - {name: gradients, epochs: 2, batch: 8192, rollout: {horizon: 50, stride: 50},
     optimizer: {adam: {lr: 0.003}}}
  - {name: squares, epochs: 1, rollout: {horizon: 50, stride: 50}, optimizer: levenberg_marquardt}
"""

GROUP = 1_000_000
FILE = 10_000_000


def main() -> None:
    arguments = argparse.ArgumentParser()
    arguments.add_argument("folder", type=Path)
    arguments.add_argument("--rows", type=int, default=100_000_000)
    arguments.add_argument("--limit", type=float, default=2.0, help="GiB")
    arguments.add_argument("--write", action="store_true")
    arguments.add_argument("--trains", action="store_true", help="Used by the script itself.")
    given = arguments.parse_args()
    if given.trains:
        train(given.folder, int(given.limit * 2**30))
        return
    folder = given.folder / "rows_on_disk"
    folder.mkdir(parents=True)
    try:
        said = [generate(folder, given.rows), *trained(folder, given.limit)]
    finally:
        shutil.rmtree(folder)
    if given.write:
        write_section(f"rows_on_disk.py FOLDER --rows {given.rows}", said)


def generate(folder: Path, rows: int) -> str:
    """Writes the data: one folder per vehicle, ten row groups per file, with an unused column
    `spare`.
    """
    import pyarrow as arrow
    import pyarrow.parquet as parquet

    (folder / "fleet.yaml").write_text(SPEC)
    generator = np.random.default_rng(0)
    began = time.monotonic()
    files = {
        f"train/vehicle={begin // FILE}": min(FILE, rows - begin) for begin in range(0, rows, FILE)
    }
    for name, count in {**files, "val": GROUP}.items():
        place = folder / name
        place.mkdir(parents=True)
        file = place / "log.parquet"
        with parquet.ParquetWriter(
            file, arrow.schema([(n, arrow.float32()) for n in "uxs"])
        ) as out:
            for _ in range(0, count, GROUP):
                u = generator.normal(size=GROUP)
                x = 0.3 * np.concatenate(([0.0], u[:-1])) + 0.01 * generator.normal(size=GROUP)
                columns = {"u": u, "x": x, "s": u}
                made = {name: arrow.array(c.astype(np.float32)) for name, c in columns.items()}
                out.write_table(arrow.table(made))
    size = sum(path.stat().st_size for path in folder.rglob("*.parquet"))
    said = f"{rows:,} rows written in {time.monotonic() - began:.0f} s, {size / 1e9:.2f} GB"
    print(said, flush=True)
    return said


def trained(folder: Path, limit: float) -> list[str]:
    """Trains on the files in a process of its own; returns the lines that it prints."""
    words = [sys.executable, __file__, str(folder), "--trains", "--limit", str(limit)]
    environment = {**os.environ, "MSNN_CACHE": str(folder / "cache")}
    said: list[str] = []
    with subprocess.Popen(words, env=environment, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        for line in process.stdout:
            print(line, end="", flush=True)
            said.append(line.rstrip())
    if process.returncode:
        sys.exit(process.returncode)
    return said


def train(folder: Path, limit: int) -> None:
    resource.setrlimit(resource.RLIMIT_DATA, (limit, limit))
    import msnn

    own: list[int] = []
    threading.Thread(target=watch, args=(own,), daemon=True).start()
    began = time.monotonic()

    def heard(event: object) -> None:
        print(f"{time.monotonic() - began:6.1f} s  {type(event).__name__}  {memory()}", flush=True)

    found = msnn.train(msnn.load(folder / "fleet.yaml"), runs=folder / "runs", progress=heard)
    print(f"{time.monotonic() - began:.1f} s, {time.process_time():.1f} s of the processor")
    print(f"peak of its own memory {max(own) / 2**20:.2f} GiB; {memory()}")
    print({name: np.round(value, 3).tolist() for name, value in found.weights.items()})


def watch(own: list[int]) -> None:
    while True:
        own.append(figure("RssAnon"))
        time.sleep(0.02)


def memory() -> str:
    peak, now = figure("VmHWM") / 2**20, figure("RssAnon") / 2**20
    return f"peak with mapped files {peak:.2f} GiB, its own now {now:.2f} GiB"


def figure(name: str) -> int:
    """A value in KiB that Linux reports for this process."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return int(next(line for line in lines if line.startswith(name)).split()[1])


if __name__ == "__main__":
    main()
