"""Reads random data sets and compares every row with a reference that is written row by row.

`python -m benchmarks.fuzz.data_sets [--count 500] [--first SEED] [--findings FOLDER]`. Draws files
(one to three; CSV, TSV, Excel, Parquet, HDF5, MAT, NPZ), even, jittered, fast, slow and uneven
times with pauses, missing values, units and where they stand, clocks and the keys of `data:`. The
reference is plain Python and numpy, after docs/language.md. A finding is a folder with spec and
files. Tenths of a second each.
"""

from __future__ import annotations

import argparse
import random
import shutil
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.fuzz.data_files import Table, drawn_clock, key_text, write_files
from benchmarks.fuzz.data_reference import NAMES, SPLITS, STEP, Rows, reference
from msnn.data.dataset import Dataset
from msnn.data.reading.load import load_data
from msnn.data.reading.row_filter import row_filters
from msnn.model.load import load_model
from spec_schema.diagnostics.diagnostic import SpecError

SPEC = """
msnn: 1
name: plant
sample_time: 100 ms
inputs: {{u: V, z: K}}
targets: {{y: m/s}}
parameters: {{k: {{init: 1}}}}
outputs:
  o: {{expr: k * u + z, predicts: "y[t]"}}
  q: {{expr: "z[t] + u[t]", predicts: "z[t+1]"}}
data:
  source: {{train: [{files}]}}
{keys}
"""


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--count", type=int, default=500)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--findings", type=Path, default=Path("build/data_sets"))
    arguments = parser.parse_args()
    began, found, read = time.monotonic(), 0, 0
    for seed in range(arguments.first, arguments.first + arguments.count):
        folder: Path = arguments.findings / f"seed_{seed}"
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        fault, is_read = trial(seed, folder)
        read += is_read
        if fault is None:
            shutil.rmtree(folder)
            continue
        found += 1
        print(f"seed {seed}: {fault}", flush=True)
    seconds = time.monotonic() - began
    refused = arguments.count - read
    print(f"{arguments.count} data sets ({refused} refused), {found} findings, {seconds:.0f} s")
    return 1 if found else 0


def trial(seed: int, folder: Path) -> tuple[str | None, bool]:
    """Tests one seed in `folder`; returns the difference, and if the reference could read the
    files.
    """
    rng = random.Random(seed)  # noqa: S311  (repeatable, no secret)
    tables, keys = drawn_tables(rng), drawn_keys(rng)
    if "duplicates" in keys:
        tables = [with_repeated_rows(table, rng) for table in tables]
    if rng.random() < 0.3:
        rng.shuffle(tables)
    clock = drawn_clock(rng)
    files, layout = write_files(tables, clock, folder, rng)
    said = {**layout, **{k: v if k == "gap" else key_text(v, clock) for k, v in keys.items()}}
    lines = [f"  {key}: {value}" for key, value in said.items()]
    spec = folder / "plant.msnn.yaml"
    spec.write_text(SPEC.format(files=", ".join(files), keys="\n".join(lines)))
    expected, codes = reference(tables, keys, clock)
    try:
        model = load_model(spec)
        assert model.spec.data is not None
        data = load_data(model.program, model.spec.data, folder, row_filters(model.spec))
    except SpecError as error:
        found = {one.code for one in error.diagnostics if one.severity == "error"}
        return (None if found == codes else f"refused by {found}, not {codes or 'read'}"), False
    if codes:
        return f"read, not refused by {codes}", False
    return difference(data, expected), True


def drawn_tables(rng: random.Random) -> list[Table]:
    """Random tables in SI units, one per file; NaN is a missing value."""
    kind = rng.choice(["even", "even", "jitter", "fast", "slow", "uneven"])
    step = {"fast": 0.037, "slow": 0.16}.get(kind, STEP)
    begin, pauses = rng.choice([0.0, 0.0, 3.2]), rng.random() < 0.3
    tables: list[Table] = []
    for _ in range(rng.choice([1, 1, 2, 3])):
        count = rng.randint(6, 30)
        moments = begin + step * np.arange(count)
        if kind == "jitter":
            moments += [rng.uniform(-0.02, 0.02) for _ in moments]
        if kind == "uneven":
            steps = [rng.choice([0.1, 0.1, 0.05, 0.13, 0.2]) for _ in moments[1:]]
            moments = begin + np.cumsum([0.0, *steps])
        if rng.random() < 0.25 and count > 8:
            moments[rng.randint(3, count - 3) :] += rng.choice([0.1, 0.35, 0.9])
        table: Table = {"t": np.round(moments, 6)}
        for name in NAMES:
            values = np.array([round(rng.uniform(-1, 1), 4) + 1e-5 for _ in moments])
            kept, index = rng.random(), np.arange(count)
            if (name == "y" and kept < 0.7) or (name == "z" and kept < 0.3):  # a slower sensor
                every = rng.randint(2, 6 if name == "y" else 4)
                phase = rng.randint(0, every - 1) if name == "y" else 0
                values[index % every != phase] = np.nan
            elif kept > 0.85:
                values[rng.randint(0, count - 1)] = np.nan
            table[name] = values
        tables.append(table)
        begin = float(table["t"][-1]) + step
        if pauses and rng.random() < 0.6:
            begin += rng.choice([-0.3, 0.4, 2.0])
    return tables


def with_repeated_rows(table: Table, rng: random.Random) -> Table:
    """The table with one to three more rows at the time of some rows, with other values."""
    rows = [row for row in range(len(table["t"])) for _ in range(rng.choice([1] * 6 + [2, 4]))]
    found = {name: values[rows] for name, values in table.items()}
    repeated = np.append(False, np.diff(rows) == 0)
    for name in NAMES:
        others = [rng.choice([np.nan, round(rng.uniform(-1, 1), 4)]) for _ in rows]
        found[name] = np.where(repeated, others, found[name])
    return found


def drawn_keys(rng: random.Random) -> dict[str, str]:
    choices = {
        "resample": (0.8, ["linear", "nearest", "none", "linear"]),
        "nan": (0.8, ["split", "split", "drop", "error"]),
        "gap": (0.3, ["1.2", "2", "4", "0.25 s", "1.3 s"]),
        "duplicates": (0.3, ["first", "last", "mean"]),
        "join": (0.5, ["true"]),
        "from": (0.3, ["2", "5", "0.25 s", "0.5 s"]),
        "to": (0.3, ["9", "12", "1.15 s", "1.5 s"]),
        "every": (0.2, ["2", "3"]),
        "filter": (0.3, ['"u > -0.5"', '"u > 0.2"']),
        "split": (0.4, list(SPLITS)),
    }
    keys = {key: rng.choice(values) for key, (p, values) in choices.items() if rng.random() < p}
    if keys.get("resample") not in ("linear", "nearest"):
        keys.pop("gap", None)  # E0876
    return keys


def difference(data: Dataset, expected: Sequence[Rows]) -> str | None:
    """The first difference between the data that msnn read and the expected rows; None
    without any.
    """
    lengths = [record.stop - record.start for record in data.records]
    if lengths != [len(one.time) for one in expected]:
        return f"recordings of {lengths} rows, not {[len(one.time) for one in expected]}"
    for number, (record, one) in enumerate(zip(data.records, expected, strict=True)):
        rows = slice(record.start, record.stop)
        place = f"recording {number}"
        measured = data.measured.get("z", np.ones(data.rows, bool))[rows]
        for what, found, right in (
            ("usable", data.usable[rows], one.usable),
            ("continues", data.continues[rows], one.continues),
            ("measured", measured & one.usable, one.z_measured & one.usable),
            ("sets", data.set_of_row[rows], one.sets),
        ):
            if not np.array_equal(found, right):
                return f"{what} of {place}: {found}, not {right}"
        for name in NAMES:
            found = np.where(one.usable, data.series[name][rows], 0)
            right = np.where(one.usable, one.columns[name], 0)
            if not np.allclose(found, right, rtol=1e-9, atol=1e-9, equal_nan=True):
                return f"`{name}` of {place}: {found}, not {right}"
    return None


if __name__ == "__main__":
    raise SystemExit(main())
