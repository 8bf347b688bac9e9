"""Imports a model that nnodely saved and compares its run with the one that nnodely recorded."""

from __future__ import annotations

import gzip
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import msnn
from compiler.ir.types import WINDOW
from msnn.api.models import import_nnodely
from msnn.features.nnodely.import_model import WrittenImport

RECORDS = Path(__file__).parent / "records"

TOLERANCE = 1e-5
"""The promise of an import. The peer computes in single precision, with 6e-8 for each operation."""


@dataclass(frozen=True)
class RecordedModel:
    """A saved model, the log that it was run over and what it gave."""

    model: str
    first: int
    """Row of the log at which the first step was evaluated."""
    log: Mapping[str, NDArray[np.float64]]
    outputs: Mapping[str, NDArray[np.float64]]
    doubles: Mapping[str, NDArray[np.float64]]
    """What its code gave in double precision; nothing where that was not tried or failed."""


def recorded(name: str) -> dict[str, RecordedModel]:
    """The recorded models of a file, by their names."""
    text = gzip.decompress((RECORDS / f"{name}.json.gz").read_bytes())
    return {key: read_record(value) for key, value in json.loads(text).items()}


def read_record(given: dict[str, Any]) -> RecordedModel:
    """A record as the worker of the peer writes it."""
    return RecordedModel(
        given["model"],
        given["first"],
        {key: np.asarray(value, np.float64) for key, value in given["log"].items()},
        {key: np.asarray(value, np.float64) for key, value in given["outputs"].items()},
        {key: np.asarray(value, np.float64) for key, value in given.get("doubles", {}).items()},
    )


def imported(record: RecordedModel, folder: Path) -> WrittenImport:
    """The record's model as files in a folder."""
    file = folder / "model.json"
    file.write_text(record.model, encoding="utf-8")
    return import_nnodely(file)


def deviations(
    record: RecordedModel, written: WrittenImport, engine: str = "interpreter"
) -> dict[str, float]:
    """The largest difference of each output, relative to its largest magnitude or 1."""
    model = msnn.load(written.spec)
    names = written.model.names
    log = {names["input"][old]: values for old, values in record.log.items()}
    rows = max(map(len, record.outputs.values()), default=0)
    shapes = {s.name: tuple(a.size for a in s.axes) for s in model.program.signals}
    # what the peer was not given begins at 0
    length = max((len(values) for values in log.values()), default=record.first + rows + 1)
    nothing = {name: np.zeros((length, *shape)) for name, shape in shapes.items()}
    log = nothing | {name: values for name, values in log.items() if name in shapes}
    predicted = _predicted(
        model, log, first=record.first, rows=rows, weights=written.weights, engine=engine
    )
    axes = {
        output.name: model.program.step.nodes[output.node].type.axes
        for output in model.program.outputs
    }
    found: dict[str, float] = {}
    for old, wanted in record.outputs.items():
        name = names["output"][old]
        got = predicted[name][:rows]
        if got.ndim == 3 and axes[name][-1].name == WINDOW:
            got = np.swapaxes(got, 1, 2)
        got = got.reshape(wanted.shape)
        found[old] = float(np.max(np.abs(got - wanted)) / max(1.0, float(np.max(np.abs(wanted)))))
    return found


def _predicted(
    model: msnn.Model,
    log: Mapping[str, NDArray[np.float64]],
    *,
    first: int,
    rows: int,
    weights: Path,
    engine: str,
) -> Mapping[str, NDArray[np.float64]]:
    """The outputs from the step on at which the record begins."""
    if not log:  # it reads nothing, and no data say how many steps it has
        one = msnn.stepper(model, weights).step()
        return {name: np.repeat(np.asarray(value)[None], rows, 0) for name, value in one.items()}
    (probe,) = msnn.simulate(model, log, weights, engine=engine)
    start = first - probe.first
    assert start >= 0, "the import looks back further than nnodely"
    log = {name: values[start:] for name, values in log.items()}
    (run,) = msnn.simulate(model, log, weights, engine=engine)
    return run.outputs
