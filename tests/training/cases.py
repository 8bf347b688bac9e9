"""Small specs and data sets for the tests of training, validation and simulation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from compiler.elaboration.compile import compile_spec
from compiler.ir.program import Program
from msnn.data.dataset import Dataset, FloatArray, Record
from spec_schema.reading.reader import read_spec
from spec_schema.sections.spec import Spec
from tests.data.whole_file import whole_file

GAIN = """
msnn: 1
name: gain
sample_time: 1 s
inputs: {x: m, u: m}
parameters: {a: 0.5, b: 0.0}
outputs:
  x_next: {expr: "a*x + b*u", predicts: "x[t+1]", unit: m}
"""
"""x[t+1] = a·x[t] + b·u[t]; the data below is made with a = 0.8, b = 0.3."""


def compiled(text: str) -> tuple[Program, Spec]:
    """The program of a spec's text, and the spec."""
    spec = read_spec("plant.msnn.yaml", text).spec
    return compile_spec(spec, spec_hash="0" * 64).program, spec


def gain(train: str = "", more: str = "") -> tuple[Program, Spec]:
    """The gain model with a `train` section and further sections."""
    return compiled(GAIN + (f"train:\n{train}" if train else "") + more)


def gain_series(rows: int, seed: int = 0) -> dict[str, FloatArray]:
    """Exact data of the gain model."""
    random = np.random.default_rng(seed)
    u = random.uniform(-1, 1, rows)
    x = np.zeros(rows)
    x[0] = random.uniform(-1, 1)
    for t in range(rows - 1):
        x[t + 1] = 0.8 * x[t] + 0.3 * u[t]
    return {"x": x, "u": u}


def dataset(series: dict[str, FloatArray], **episodes: list[int]) -> Dataset:
    """Records of the given lengths, one after the other, in the named sets.

    `dataset(series, train=[10, 7], val=[5])` has three records in rows 0…9, 10…16 and 17…21.
    """
    names = tuple(episodes)
    records: list[Record] = []
    codes: list[np.ndarray] = []
    continues: list[np.ndarray] = []
    start = 0
    for code, name in enumerate(names):
        for length in episodes[name]:
            records.append(whole_file(f"{name}{len(records)}.csv", start, start + length))
            codes.append(np.full(length, code, dtype=np.int8))
            continues.append(np.arange(length) > 0)
            start += length
    return Dataset(
        series={name: values[:start] for name, values in series.items()},
        records=tuple(records),
        sets=names,
        set_of_row=np.concatenate(codes),
        continues=np.concatenate(continues),
        usable=np.ones(start, dtype=np.bool_),
    )


def in_blocks(data: Dataset, name: str, rows: slice) -> Dataset:
    """The data set with some rows moved to another set."""
    sets = data.sets if name in data.sets else (*data.sets, name)
    codes = data.set_of_row.copy()
    codes[rows] = sets.index(name)
    return replace(data, sets=sets, set_of_row=codes)
