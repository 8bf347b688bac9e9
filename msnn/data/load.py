"""Reads all data of a spec into one `Dataset`, and reports every bad file at once."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from compiler.program import Program, Signal
from msnn.data.dataset import Dataset, Record
from msnn.data.files import DataFile, find_files
from msnn.data.part import Part, read_part
from msnn.data.splits import SETS, SetCodes, split_rows, split_source
from spec_schema.data_section import Data
from spec_schema.diagnostics import Diagnostic, Findings, SpecError
from spec_schema.errors import data_files as errors
from spec_schema.source import SourceText

_LARGEST_SHOWN = 1_000_000


def load_data(program: Program, data: Data, folder: Path) -> Dataset:
    """The measured series of all signals of the program, divided into records and sets.

    Relative paths start in `folder`: that of the spec, or `--data-root`. Raises SpecError with
    the faults of all files.
    """
    findings = Findings()
    files = find_files(data, folder, findings)
    parts = [part for file in files if (part := read_part(program, data, file, findings))]
    if findings.failed:
        faults = _once(findings.in_order)
        raise SpecError(faults, _texts(files, faults))
    if data.nan == "drop" and program.sample_time is not None:
        parts = [part for part in parts if not _dropped(part, findings)]
    sets = _set_names(data)
    rows = _sets(data, parts, sets, findings)
    _report_ranges(program.signals, parts, findings)
    findings.raise_errors()
    return _joined(program, parts, sets, rows, findings.in_order)


def _texts(files: Iterable[DataFile], faults: Iterable[Diagnostic]) -> list[SourceText]:
    """The texts of faulty files, so that messages can show the line; large ones are only named."""
    faulty = {fault.span.file for fault in faults if fault.span is not None}
    return [
        SourceText(file.shown, file.path.read_text("utf-8-sig", errors="replace"))
        for file in files
        if file.shown in faulty and file.path.stat().st_size <= _LARGEST_SHOWN
    ]


def _once(faults: Iterable[Diagnostic]) -> list[Diagnostic]:
    """Faults with those that differ in the file only as one: it names the first file."""
    alike: dict[Diagnostic, list[Diagnostic]] = {}
    for fault in faults:
        file = "" if fault.span is None else fault.span.file
        # a fault without a place says nothing of which file it is in
        kind = replace(fault, message=fault.message.replace(file, ""), span=None) if file else fault
        alike.setdefault(kind, []).append(fault)
    return [
        same[0].also_in(len({f.span and f.span.file for f in same}) - 1) for same in alike.values()
    ]


def _dropped(part: Part, findings: Findings) -> bool:
    if part.usable.all():
        return False
    row = part.picked.first + int(np.argmin(part.usable)) * part.picked.every
    findings.report(errors.record_dropped(part.file.shown, row))
    return True


def _set_names(data: Data) -> tuple[str, ...]:
    names = list(data.source)
    if data.split is not None:
        names += [name for name in SETS if name not in names]
    return tuple(names)


def _sets(
    data: Data, parts: Sequence[Part], sets: Sequence[str], findings: Findings
) -> list[SetCodes]:
    """The set of every row of every part."""
    codes = {name: index for index, name in enumerate(sets)}
    rows = [np.full(len(p.usable), codes[p.file.source], dtype=np.int8) for p in parts]
    if data.split is None:
        return rows
    divided = split_source(tuple(data.source), data.split, findings)
    chosen = [index for index, part in enumerate(parts) if part.file.source == divided]
    lengths = [len(rows[index]) for index in chosen]
    for index, codes_of_rows in zip(
        chosen, split_rows(data.split, lengths, codes, findings), strict=True
    ):
        rows[index] = codes_of_rows
    return rows


def _report_ranges(signals: Sequence[Signal], parts: Sequence[Part], findings: Findings) -> None:
    """Data outside a signal's `range:` is a warning, never clamped (rule R10)."""
    for signal in signals:
        if signal.range is None:
            continue
        low, high = signal.range
        excess = 0.0
        worst, count = 0.0, 0
        for part in parts:
            values = part.series[signal.name]
            beyond = np.fmax(low - values, values - high)
            count += int(np.sum(beyond > 0))
            most = float(np.nanmax(beyond, initial=0.0)) if beyond.size else 0.0
            if most > excess:
                excess = most
                worst = float(values.ravel()[np.nanargmax(beyond)])
        if count:
            unit = f" {signal.unit.text}" if signal.unit else ""
            findings.report(errors.outside_range(signal.name, count, worst, low, high, unit))


def _joined(
    program: Program,
    parts: Sequence[Part],
    sets: tuple[str, ...],
    rows: Sequence[SetCodes],
    warnings: tuple[Diagnostic, ...],
) -> Dataset:
    records: list[Record] = []
    start = 0
    for part in parts:
        stop = start + len(part.usable)
        records.append(Record(part.file.shown, start, stop, part.picked.first, part.picked.every))
        start = stop
    none = np.zeros(0, dtype=np.bool_)
    return Dataset(
        series={
            signal.name: np.concatenate(
                [part.series[signal.name] for part in parts]
                or [np.zeros((0, *(axis.size for axis in signal.axes)))]
            )
            for signal in program.signals
        },
        records=tuple(records),
        sets=sets,
        set_of_row=np.concatenate([np.zeros(0, dtype=np.int8), *rows]),
        continues=np.concatenate([none, *(part.continues for part in parts)]),
        usable=np.concatenate([none, *(part.usable for part in parts)]),
        warnings=warnings,
    )
