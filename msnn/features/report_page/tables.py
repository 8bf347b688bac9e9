"""Fills the tables of the page: measurements, parameters, recordings, signals, memory."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from compiler.ir.program import Program
from msnn.data.dataset import UNASSIGNED, Dataset
from msnn.exports.describe import range_text
from msnn.reports.drawn import channels
from msnn.training.records.learned.parameters_record import has_unidentified
from msnn.training.records.run_log import Cost
from msnn.validation.measurement import Measurement
from msnn.validation.reports.report import limits
from msnn.validation.reports.words import difference_text, rollout_text, unit_of_record, unit_text
from msnn.validation.validate import MetricRow

_MOST_NUMBERS = 6
_MOST_LISTED = 256


@dataclass(frozen=True, slots=True)
class PageRow:
    """The cells of a row; `verdict` colours the last one, `more` is shown on demand."""

    cells: tuple[str, ...]
    verdict: str = ""
    more: str = ""


@dataclass(frozen=True, slots=True)
class PageTable:
    """A table with its caption; columns in `numbers` are right-aligned."""

    caption: str
    header: tuple[str, ...]
    rows: tuple[PageRow, ...]
    numbers: tuple[int, ...] = ()


def short(value: float | None, digits: int = 5) -> str:
    """A formatted number; a dash for None."""
    return "–" if value is None or not math.isfinite(value) else f"{value:.{digits}g}"


def limits_table(rows: Sequence[MetricRow]) -> PageTable:
    """The metrics of the spec with their limits."""
    verdicts = {True: "kept", False: "broken", None: ""}
    return PageTable(
        "What the spec asks",
        ("of", "metric", "value", "unit", "limit", "how", "data", "verdict"),
        tuple(
            PageRow(
                (
                    row.of,
                    row.metric,
                    short(row.value),
                    unit_text(row.unit),
                    limits(row),
                    rollout_text(row),
                    row.data,
                    verdicts[row.passed],
                ),
                {True: "good", False: "bad", None: ""}[row.passed],
            )
            for row in rows
        ),
        (2,),
    )


def measurements_table(measurements: Sequence[Measurement]) -> PageTable:
    """Every metric of each output and kind of simulation."""
    metrics = ("fit", "rmse", "mae", "max_abs", "r2")
    return PageTable(
        "Every metric",
        ("of", "how", "data", "fit %", "rmse", "mae", "max", "r²", "unit", "values"),
        tuple(
            PageRow(
                (
                    found.of,
                    rollout_text(found),
                    found.data,
                    *(short(found.metrics[metric].value) for metric in metrics),
                    unit_text(found.unit),
                    str(found.scored),
                )
            )
            for found in measurements
        ),
        (3, 4, 5, 6, 7, 9),
    )


def parameters_table(record: Mapping[str, Any], program: Program) -> PageTable:
    """Learned values with units, standard errors and docs; long arrays open on demand."""
    docs = {parameter.name: parameter.doc for parameter in program.parameters}
    rows: list[PageRow] = []
    for found in record["parameters"]:
        values, errors = found["values"], found["standard_errors"]
        remark = "" if found["learn"] else "fixed"
        if found["at_bound"]:
            remark = "at its bound"
        elif found["learn"] and has_unidentified(record, found):
            remark = "not identifiable"
        rows.append(
            PageRow(
                (
                    found["name"],
                    _numbers(values),
                    difference_text(_errors(errors), unit_of_record(found["unit"])),
                    found["unit"] or "",
                    _numbers(found["initial"]),
                    remark,
                    docs.get(found["name"], "").strip().partition("\n")[0],
                ),
                "bad" if remark in ("at its bound", "not identifiable") else "",
                _listed(values, errors),
            )
        )
    header = ("parameter", "value", "± std. error", "unit", "initial", "remark", "doc")
    return PageTable("Parameters", header, tuple(rows))


def _numbers(values: Sequence[float | None]) -> str:
    if len(values) <= _MOST_NUMBERS:
        return ", ".join(short(value) for value in values)
    known = [value for value in values if value is not None]
    if not known:
        return f"{len(values)} numbers"
    return f"{len(values)} numbers, {short(min(known), 4)} … {short(max(known), 4)}"


def _errors(errors: Sequence[float | None] | None) -> str:
    if errors is None or not any(error is not None for error in errors):
        return ""
    if len(errors) <= _MOST_NUMBERS:
        return ", ".join(short(error, 2) for error in errors)
    known = [error for error in errors if error is not None]
    return f"{short(min(known), 2)} … {short(max(known), 2)}"


def _listed(values: Sequence[float | None], errors: Sequence[float | None] | None) -> str:
    if len(values) <= _MOST_NUMBERS:
        return ""
    shown = [
        short(value) + ("" if errors is None or errors[i] is None else f" ± {short(errors[i], 2)}")
        for i, value in enumerate(values[:_MOST_LISTED])
    ]
    rest = len(values) - len(shown)
    return ", ".join(shown) + (f", … {rest} more" if rest else "")


def data_tables(program: Program, data: Dataset) -> Iterator[PageTable]:
    """Recordings by set, and statistics of each signal."""
    sets = [*data.sets, *(["no set"] if (data.set_of_row == UNASSIGNED).any() else [])]
    rows = tuple(
        PageRow((name, str(records), str(count), _duration(program, count)))
        for name in sets
        for records, count in [_in_set(data, name)]
        if count
    )
    yield PageTable("Sets", ("set", "records", "rows", "time"), rows, (1, 2, 3))
    signals = [signal for signal in program.signals if signal.name in data.series]
    units = {signal.name: signal.unit for signal in signals}
    found: list[PageRow] = []
    for channel in channels(signals):
        values = channel.of(data.series[channel.source])
        known = values[np.isfinite(values)]
        low, mean, high, spread = (
            (known.min(), known.mean(), known.max(), known.std()) if len(known) else [math.nan] * 4
        )
        found.append(
            PageRow(
                (
                    channel.name,
                    channel.unit,
                    *(short(float(value), 4) for value in (low, mean, high)),
                    difference_text(short(float(spread), 4), units[channel.source]),
                    str(len(values) - len(known)),
                    "" if channel.low is None else range_text((channel.low, channel.high or 0.0)),
                )
            )
        )
    header = ("signal", "unit", "least", "mean", "most", "deviation", "missing", "declared range")
    yield PageTable("Signals", header, tuple(found), (2, 3, 4, 5, 6))


def _in_set(data: Dataset, name: str) -> tuple[int, int]:
    wanted = data.in_set(name) if name in data.sets else data.set_of_row == UNASSIGNED
    records = sum(bool(wanted[r.start : r.stop].any()) for r in data.records)
    return records, int(wanted.sum())


def _duration(program: Program, rows: int) -> str:
    if program.sample_time is None:
        return ""
    seconds = rows * program.sample_time
    return f"{seconds / 60:.4g} min" if seconds >= 120 else f"{seconds:.4g} s"


def c_table(memory: Mapping[str, int], cost: Cost | None) -> PageTable:
    """Bytes of the C code, and the cost of a step if measured."""
    rows = [PageRow((what, str(size), "bytes")) for what, size in memory.items()]
    if cost is not None:
        core = f" ({cost.core})"
        rows += [
            PageRow((f"a step{core}", f"{cost.instructions:.0f}", "instructions")),
            PageRow((f"code and constants{core}", str(cost.flash), "bytes")),
            PageRow((f"variables{core}", str(cost.ram), "bytes")),
        ]
    return PageTable("Footprint of the C", ("what", "size", "unit"), tuple(rows), (1,))


def verification_table(found: Mapping[str, Any]) -> PageTable:
    """The checks of `msnn verify --format json`."""
    rows = tuple(
        PageRow(
            (
                str(result["check"]),
                str(result["target"]),
                str(result["detail"]),
                str(result["verdict"]),
            ),
            {"ok": "good", "found": "bad"}.get(str(result["verdict"]), ""),
        )
        for result in found["results"]
    )
    caption = f"What `msnn verify` found of the C of {found['model']}"
    return PageTable(caption, ("check", "target", "detail", "verdict"), rows)
