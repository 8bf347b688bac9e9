"""The log of trainings, `runs.jsonl`: one line each, which comparisons, sweeps and reports read."""

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
from msnn.training.records.metrics_log import finite
from msnn.validation.reports.words import rollout_text
from msnn.validation.validate import ValidationReport
from spec_schema.reading.endless_files import refuse_endless

LOG = "runs.jsonl"

Number: TypeAlias = Annotated[float, BeforeValidator(lambda v: math.nan if v is None else v)]
"""JSON has no word for NaN: there it is null."""

State = Literal["finished", "diverged", "refused"]
"""`refused` is a spec, or data, with mistakes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Measured:
    """The metrics of one output, or loss, simulated one way over one set."""

    of: str
    unit: str
    """As the spec writes it; empty where there is none."""
    rollout: str
    """`one step`, `50 steps, closing x`."""
    scored: int
    asked: str
    """The metric that the first entry asks for."""
    metrics: Mapping[str, Number]
    """All of them by name; `rmse`, `mae`, `max_abs` in the unit, `fit` in percent."""

    @property
    def way(self) -> tuple[str, str, str]:
        """The properties that two models must share for their metrics to be compared."""
        return self.of, self.rollout, self.unit


@dataclass(frozen=True, slots=True)
class Cost:
    """The cost of one step of the exported C on one core."""

    core: str
    """With the level of optimisation: `Cortex-M4F -O2`."""
    instructions: float
    """Mean over the golden steps."""
    flash: int
    """Bytes of code and constants."""
    ram: int
    """Bytes of variables."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunLine:
    """One training: of what, how it ended, what was measured of it, what its C costs."""

    format: Literal[1] = 1
    key: str
    """sha256 of all that decides the result: model, settings, data, seed, fold."""
    model: str
    spec: str
    spec_sha256: str
    settings: tuple[str, ...]
    seed: int
    fold: int | None
    """Which fold was held out, from 1."""
    data_sha256: str
    state: State
    reason: str
    """Why the last stage ended, or what is wrong."""
    monitor: Number = math.nan
    """What the last stage reached."""
    seconds: float = 0.0
    """Of all stages, without building kernels."""
    parameters: int = 0
    """Numbers that were learned."""
    held_out: tuple[Measured, ...] = ()
    training: tuple[Measured, ...] = ()
    """The same on the rows that were trained on."""
    cost: Cost | None = None
    folder: str | None = None
    """Of the run, seen from the log."""
    version: str = ""
    """Of msnn."""
    warnings: tuple[str, ...] = ()
    drawn_by: int | None = None
    """The seed of a sweep that drew some of the settings."""


def append(log: Path, line: RunLine) -> None:
    """Adds one line; several processes may do so at once, and what one left torn stays apart."""
    text = json.dumps(finite(asdict(line)), ensure_ascii=False)
    with naming(log):
        log.parent.mkdir(parents=True, exist_ok=True)
        # a killed process left half a line: it must not swallow the next one
        begin = "\n" if _is_torn(log) else ""
        with log.open("ab", buffering=0) as file:
            # one write at the end of the file: lines of two processes do not mix
            file.write(f"{begin}{text}\n".encode())


def read(log: Path) -> list[RunLine]:
    """All lines that can be read, oldest first; none where there is no log."""
    if not log.exists():
        return []
    refuse_endless(log)
    with log.open(encoding="utf-8", errors="replace") as file:
        return [line for text in file if (line := _line(text)) is not None]


def measured_in(report: ValidationReport) -> tuple[Measured, ...]:
    """Each output and way to simulate it once, with all metrics; losses with their own."""
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
    """Whether the last line has no end: its process was killed."""
    if not log.exists() or not log.stat().st_size:
        return False
    refuse_endless(log)
    with log.open("rb") as file:
        file.seek(-1, os.SEEK_END)
        return file.read(1) != b"\n"


def _line(text: str) -> RunLine | None:
    """A line that this version can read; what a killed process left torn is none."""
    try:
        return _READER.validate_json(text)
    except ValidationError:
        return None


_READER = TypeAdapter(RunLine)
