"""Trains into a real file system that runs full: a tmpfs of a few sizes. Linux, needs root.

`full_disk.py [KILOBYTES…]`. The metrics of the training alone do not fit. Prints how it ended,
which file was named, whether the weights can be read, and whether the run, resumed after the file
system was made larger, ends with the bits of one that nobody disturbed. Exit code 1 if not so.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from benchmarks.kills.cases import gain_frame, gain_model
from msnn.model.model import Model
from msnn.model.model_data import measured
from msnn.model.saved_run import CHECKPOINT, WEIGHTS
from msnn.model.weights.weights_file import read_weights
from msnn.tables import table_text
from msnn.training.records.run_folder import METRICS
from msnn.training.records.training_options import TrainingOptions
from msnn.training.train import train
from msnn.training.training_result import TrainingResult
from spec_schema.diagnostics.diagnostic import SpecError

_EPOCHS = 1000
_MOST_LOST = 0.6
"""Seconds: a checkpoint every tenth of a second."""


def main() -> int:
    sizes = [int(size) for size in sys.argv[1:]] or [40, 80, 120, 160, 240, 320]
    rows: list[tuple[str, ...]] = []
    with tempfile.TemporaryDirectory() as place:
        model = gain_model(Path(place), _EPOCHS)
        undisturbed = _trained(model, Path(place) / "runs")
        for size in sizes:
            with _disk(Path(place) / f"disk_{size}", size) as disk:
                rows.append((f"{size} KB", *_case(model, disk, undisturbed)))
    header = ("disk", "ended by", "file", "weights", "resumed")
    print(table_text(header, rows))
    return 0 if all(row[1] == "E0927" and row[4] == "same bits" for row in rows) else 1


@contextmanager
def _disk(folder: Path, kilobytes: int) -> Iterator[Path]:
    folder.mkdir()
    _call("mount", "-t", "tmpfs", "-o", f"size={kilobytes}k", "none", str(folder))
    try:
        yield folder
    finally:
        _call("umount", str(folder))


def _call(*command: str) -> None:
    subprocess.run(command, check=True)


def _trained(model: Model, runs: Path, *, resume: bool = False) -> TrainingResult:
    data = measured(model, gain_frame(), None, "training")
    options = TrainingOptions(runs=runs, resume=resume, most_lost=_MOST_LOST)
    return train(model.program, data, model.spec.train, options)


def _case(model: Model, disk: Path, undisturbed: TrainingResult) -> tuple[str, ...]:
    runs = disk / "runs"
    try:
        _trained(model, runs)
    except SpecError as error:
        (said,) = error.diagnostics
        files = (METRICS, CHECKPOINT, WEIGHTS)
        named = next((file for file in files if f"/{file}:" in said.message), said.message)
    else:
        return "nothing", "", "", ""
    (weights,) = [*runs.rglob(WEIGHTS)] or [None]
    kept = "none" if weights is None else "whole"
    if weights is not None:
        read_weights(weights, model.program)
    _call("mount", "-o", "remount,size=8m", str(disk))
    resumed = _trained(model, runs, resume=True)
    same = all(np.array_equal(resumed.weights[n], w) for n, w in undisturbed.weights.items())
    return said.code, named, kept, "same bits" if same else "other bits"


if __name__ == "__main__":
    raise SystemExit(main())
