"""Measures what checkpoints by the clock take of trainings of the gallery.

`cost.py [SECONDS [NAME…]]`: each model trains about so long. Prints how much of it went into asking
the clock and into saving, and how many calls of the kernel an epoch was divided into.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from msnn.model.load import load_model
from msnn.model.model_data import read_data
from msnn.tables import table_text
from msnn.training.engines.native.native_engine import NativeEngine
from msnn.training.records.safekeeping import Safekeeping
from msnn.training.records.training_options import TrainingOptions
from msnn.training.train import train
from tests.examples.gallery import NAMES, gallery_copy, spec_of

_FIRST = 30
"""Epochs from which the length of the others is known."""


def main() -> None:
    seconds, names = float((sys.argv[1:] or ["12"])[0]), sys.argv[2:] or NAMES
    timed = {
        "asked": _Timed(Safekeeping, "is_due"),
        "saved": _Timed(Safekeeping, "save"),
        "trained": _Timed(NativeEngine, "train_batches"),
    }
    rows: list[tuple[str, ...]] = []
    with tempfile.TemporaryDirectory() as place:
        gallery_copy(Path(place))
        for name in names:
            spec, runs = spec_of(Path(place), name), Path(place) / "runs"
            _trained(spec, runs, 1)  # it builds the kernel
            _, an_epoch = _trained(spec, runs, _FIRST)
            epochs = max(int(seconds / an_epoch), 1)
            for each in timed.values():
                each.seconds, each.busy, each.calls = 0.0, 0.0, 0
            before = time.process_time()
            whole, an_epoch = _trained(spec, runs, epochs)
            busy = time.process_time() - before
            asked, saved, trained = timed.values()
            part = (asked.seconds + saved.seconds) / whole
            rows.append(
                (
                    name,
                    f"{whole:.1f}",
                    f"{1e3 * an_epoch:.2f}",
                    f"{trained.calls / epochs:.2f}",
                    f"{1e3 * saved.seconds / max(saved.calls, 1):.0f} x {saved.calls}",
                    f"{100.0 * asked.seconds / whole:.3f}",
                    f"{100.0 * part:.2f}",
                    f"{100.0 * (asked.busy + saved.busy) / busy:.2f}",
                )
            )
            print(f"{name}: {100.0 * part:.2f} %", flush=True)
    header = (
        "",
        "s",
        "ms an epoch",
        "calls an epoch",
        "ms a save",
        "% clock",
        "% in all",
        "% of the processor",
    )
    print(table_text(header, rows, numbers=range(1, 8)))


def _trained(spec: Path, runs: Path, epochs: int) -> tuple[float, float]:
    """Seconds of a training in all, and of an epoch."""
    model = load_model(spec, [f"train.0.epochs={epochs}"])
    data = read_data(model, None, "training")
    began = time.monotonic()
    (stage,) = train(model.program, data, model.spec.train, TrainingOptions(runs=runs)).stages
    return time.monotonic() - began, stage.seconds / epochs


class _Timed:
    """Sums the time of all calls of a method."""

    def __init__(self, owner: type[Any], name: str) -> None:
        self.seconds, self.busy, self.calls = 0.0, 0.0, 0
        method: Callable[..., Any] = getattr(owner, name)

        def timed(*given: Any, **named: Any) -> Any:
            began, busy = time.perf_counter(), time.process_time()
            try:
                return method(*given, **named)
            finally:
                self.seconds += time.perf_counter() - began
                self.busy += time.process_time() - busy
                self.calls += 1

        setattr(owner, name, timed)


if __name__ == "__main__":
    main()
