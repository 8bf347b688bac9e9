"""The log of trainings, `runs.jsonl`: one line per training, for comparisons and reports."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Literal, TypeAlias

from pydantic import BeforeValidator, TypeAdapter, ValidationError

from backends.files.atomic_write import naming
from msnn.training.records.curves import finite
from msnn.validation.reports.words import rollout_text
from msnn.validation.validate import ValidationReport
from spec_schema.reading.reader import refuse_endless

LOG = "runs.jsonl"

Number: TypeAlias = Annotated[float, BeforeValidator(lambda v: math.nan if v is None else v)]
"""A float; null in JSON means NaN."""

State = Literal["finished", "diverged", "refused"]
"""State of a training; `refused` means errors in the spec or data."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Measured:
    """The metrics of one output or loss, for one kind of simulation and one set of the data."""

    of: str
    unit: str
    """The unit as written in the spec; empty if there is none."""
    rollout: str
    """Kind of simulation: `one step`, `50 steps, closing x`."""
    scored: int
    asked: str
    """The metric that the first entry requests."""
    metrics: Mapping[str, Number]
    """All metrics by name; `rmse`, `mae` and `max_abs` in the unit, `fit` in percent."""

    @property
    def way(self) -> tuple[str, str, str]:
        """The output, kind of simulation and unit: metrics of two models are comparable if these
        are equal.
        """
        return self.of, self.rollout, self.unit


@dataclass(frozen=True, slots=True)
class Cost:
    """The cost of one step of the exported C code on one core."""

    core: str
    """Name with optimisation level: `Cortex-M4F -O2`."""
    instructions: float
    """Mean over the steps of the golden test."""
    flash: int
    """Bytes of code and constants."""
    ram: int
    """Bytes of variables."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunLine:
    """One line of the log `runs.jsonl`: the model and settings of a training, its results and its
    cost.
    """

    format: Literal[1] = 1
    key: str
    """SHA-256 of everything that determines the result: model, settings, data, seed, fold."""
    model: str
    spec: str
    spec_sha256: str
    settings: tuple[str, ...]
    seed: int
    fold: int | None
    """Number of the held-out fold, from 1."""
    data_sha256: str
    state: State
    reason: str
    """The reason why the last stage ended, or the error."""
    monitor: Number = math.nan
    """Best monitor of the last stage."""
    seconds: float = 0.0
    """Duration of all stages, without building kernels."""
    parameters: int = 0
    """Number of learned elements."""
    held_out: tuple[Measured, ...] = ()
    training: tuple[Measured, ...] = ()
    """The same metrics on the training rows."""
    cost: Cost | None = None
    folder: str | None = None
    """Folder of the run, relative to the log."""
    version: str = ""
    """Version of msnn."""
    warnings: tuple[str, ...] = ()
    drawn_by: int | None = None
    """Seed of the sweep that drew some of the settings."""


def append(log: Path, line: RunLine) -> None:
    """Appends one line; safe with several processes, and after an incomplete line."""
    text = json.dumps(finite(asdict(line)), ensure_ascii=False)
    with naming(log):
        log.parent.mkdir(parents=True, exist_ok=True)
        # a killed process left half a line: it must not swallow the next one
        begin = "\n" if _is_torn(log) else ""
        with log.open("ab", buffering=0) as file:
            # one write at the end of the file: lines of two processes do not mix
            file.write(f"{begin}{text}\n".encode())


def read(log: Path) -> list[RunLine]:
    """All readable lines, oldest first; empty if there is no log."""
    if not log.exists():
        return []
    refuse_endless(log)
    with log.open(encoding="utf-8", errors="replace") as file:
        return [line for text in file if (line := _line(text)) is not None]


def measured_in(report: ValidationReport) -> tuple[Measured, ...]:
    """The metrics of a validation report, one entry for each output and kind of simulation.

    A loss has its value instead of metrics.
    """
    found: dict[tuple[str, str], Measured] = {}
    every = {(each.of, rollout_text(each)): each.metrics for each in report.measurements}
    for row in report.rows:
        place = row.of, rollout_text(row)
        if place in found:
            continue
        scores = {} if row.metric == "loss" else every[place]
        found[place] = Measured(
            of=row.of,
            unit="" if row.unit is None else row.unit.text,
            rollout=place[1],
            scored=row.scored,
            asked=row.metric,
            metrics={metric: each.value for metric, each in scores.items()}
            or {row.metric: row.value},
        )
    return tuple(found.values())


def _is_torn(log: Path) -> bool:
    """True if the last line is incomplete because its process was killed."""
    if not log.exists() or not log.stat().st_size:
        return False
    refuse_endless(log)
    with log.open("rb") as file:
        file.seek(-1, os.SEEK_END)
        return file.read(1) != b"\n"


def _line(text: str) -> RunLine | None:
    """The parsed line; None if it is incomplete or of another version."""
    try:
        return _READER.validate_json(text)
    except ValidationError:
        return None


_READER = TypeAdapter(RunLine)
