"""Measures the cost of checkpoints in trainings of the gallery.

`cost.py [SECONDS [NAME…]]`: each model trains for about that long. Prints the time of an epoch, the
number of kernel calls in it, the time to read the clock, and the minimum and median time of a save.
The last column is the total cost with one save every 4.5 s.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median
from timeit import timeit
from typing import Any

from msnn.model.load import load_model
from msnn.model.model_data import read_data
from msnn.tables import table_text
from msnn.training.engines.native.native_engine import NativeEngine
from msnn.training.records.progress import Silent
from msnn.training.records.resumable_run import NotedProgress, Safekeeping
from msnn.training.records.training_options import TrainingOptions
from msnn.training.train import train
from tests.examples.gallery import NAMES, gallery_copy, spec_of

_FIRST = 30
"""Epochs from which the length of the others is known."""

_MOST_LOST, _WRITING = 5.0, 0.5


def main() -> None:
    seconds, names = float((sys.argv[1:] or ["12"])[0]), sys.argv[2:] or NAMES
    saves = _timed(Safekeeping, "save")
    calls = _timed(NativeEngine, "train_batches")
    rows: list[tuple[str, ...]] = []
    with tempfile.TemporaryDirectory() as place:
        gallery_copy(Path(place))
        for name in names:
            spec, runs = spec_of(Path(place), name), Path(place) / "runs"
            _an_epoch(spec, runs, 1)  # it builds the kernel
            epochs = max(int(seconds / _an_epoch(spec, runs, _FIRST)), 1)
            saves.clear()
            calls.clear()
            an_epoch = _an_epoch(spec, runs, epochs)
            in_epoch = len(calls) / epochs
            asked = (in_epoch + 1.0) * _asking()
            part = asked / an_epoch + median(saves) / (_MOST_LOST - _WRITING)
            rows.append(
                (
                    name,
                    f"{1e3 * an_epoch:.2f}",
                    f"{in_epoch:.2f}",
                    f"{1e6 * asked:.1f}",
                    f"{len(saves)}",
                    f"{1e3 * min(saves):.0f}",
                    f"{1e3 * median(saves):.0f}",
                    f"{100.0 * part:.2f}",
                )
            )
            print(f"{name}: {100.0 * part:.2f} %", flush=True)
    header = ("", "ms an epoch", "calls", "us clock", "saves", "least ms", "middle ms", "%")
    print(table_text(header, rows, numbers=range(1, 8)))


def _an_epoch(spec: Path, runs: Path, epochs: int) -> float:
    """Seconds per epoch of a training with that many epochs."""
    model = load_model(spec, [f"train.0.epochs={epochs}"])
    data = read_data(model, None, "training")
    (stage,) = train(model.program, data, model.spec.train, TrainingOptions(runs=runs)).stages
    return stage.seconds / epochs


def _asking() -> float:
    """Seconds to read the clock once."""
    safe = Safekeeping(None, NotedProgress(Silent(), None), _MOST_LOST)
    return min(timeit(lambda: safe.is_due(0.01), number=1000) for _ in range(5)) / 1000


def _timed(owner: type[Any], name: str) -> list[float]:
    """A list that receives the seconds of each later call of a method."""
    found: list[float] = []
    method: Callable[..., Any] = getattr(owner, name)

    def timed(*given: Any, **named: Any) -> Any:
        began = time.perf_counter()
        try:
            return method(*given, **named)
        finally:
            found.append(time.perf_counter() - began)

    setattr(owner, name, timed)
    return found


if __name__ == "__main__":
    main()
