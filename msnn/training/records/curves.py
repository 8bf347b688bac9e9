"""Writes the curves of a training: `metrics.jsonl`, and files for TensorBoard."""

from __future__ import annotations

import json
import math
import os
import socket
import time
from collections.abc import Iterator, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any, cast

from backends.files.atomic_write import AppendedFile
from msnn.data.dataset import FloatArray
from msnn.packages import TENSORBOARD
from msnn.training.records.progress import EpochEnd


class MetricsLog:
    """JSON lines, each flushed immediately, so that other programs can follow them."""

    def __init__(self, path: Path) -> None:
        self._file = AppendedFile(path)

    def append(self, record: Mapping[str, Any]) -> None:
        """Appends one line; NaN and infinities become null."""
        line = json.dumps(finite(record), ensure_ascii=False) + "\n"
        self._file.write(line.encode())

    def close(self) -> None:
        """Closes the file; a later line opens it again."""
        self._file.close()


def finite(value: Any) -> Any:
    """The value with null for NaN and infinities, which JSON does not support."""
    match value:
        case float():
            return value if math.isfinite(value) else None
        case dict():
            return {key: finite(part) for key, part in cast("dict[str, Any]", value).items()}
        case list():
            return [finite(part) for part in cast("list[Any]", value)]
        case _:
            return value


MOST_NUMBERS = 16
"""Parameters with more elements are shown by minimum, mean and maximum."""


class Curves:
    """Writes an event file for TensorBoard: the scalars of each epoch, one group per stage."""

    def __init__(self, folder: Path) -> None:
        writer, self._event, self._summary = _tensorboard()
        # not its writer of event files: that has a thread, which prints a traceback where the disk
        # is full
        name = f"events.out.tfevents.{int(time.time()):010d}.{socket.gethostname()}.{os.getpid()}"
        self._file = AppendedFile(folder / name)
        self._writer = writer(self._file)
        self._is_begun = False

    def epoch_ended(self, event: EpochEnd, weights: Mapping[str, FloatArray]) -> None:
        """Writes losses, learning rate and elements of parameters after an epoch."""
        run = f"/run {event.attempt}" if event.attempts > 1 else ""
        scalars = {**_scalars(event), **dict(_numbers(weights))}
        values = [
            self._summary.Value(tag=f"{event.stage}{run}/{name}", simple_value=value)
            for name, value in scalars.items()
        ]
        if not self._is_begun:
            self._add(file_version="brain.Event:2")
            self._is_begun = True
        self._add(step=event.epoch, summary=self._summary(value=values))

    def close(self) -> None:
        """Closes the file."""
        self._file.close()

    def _add(self, **content: Any) -> None:
        record = self._event(wall_time=time.time(), **content)
        self._writer.write(record.SerializeToString())


def require_tensorboard() -> None:
    """Raises MissingExtraError if tensorboard is not installed."""
    TENSORBOARD.require("draws curves of trainings")


def _tensorboard() -> tuple[Any, Any, Any]:
    """The record writer, `Event` and `Summary`, from modules without further dependencies."""
    files = import_module("tensorboard.summary.writer.record_writer")
    events = import_module("tensorboard.compat.proto.event_pb2")
    summaries = import_module("tensorboard.compat.proto.summary_pb2")
    return files.RecordWriter, events.Event, summaries.Summary


def _scalars(event: EpochEnd) -> dict[str, float]:
    losses = {f"losses/{name}": value for name, value in event.losses.items()}
    kept = {"total": event.total, "monitor": event.monitor, "best": event.best}
    rate = {} if event.lr is None else {"lr": event.lr}
    return {**kept, **losses, **rate, "horizon": float(event.horizon)}


def _numbers(weights: Mapping[str, FloatArray]) -> Iterator[tuple[str, float]]:
    for name, value in weights.items():
        numbers = value.ravel().tolist()
        if len(numbers) == 1:
            yield f"parameters/{name}", numbers[0]
        elif len(numbers) <= MOST_NUMBERS:
            yield from ((f"parameters/{name}/{i}", each) for i, each in enumerate(numbers))
        else:
            yield f"parameters/{name}/min", min(numbers)
            yield f"parameters/{name}/mean", sum(numbers) / len(numbers)
            yield f"parameters/{name}/max", max(numbers)
