"""Reports the faults of each column, their place, and a change of the spec."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from compiler.ir.program import Role
from msnn.data.reading.rows import GAP_TOLERANCE
from msnn.errors.data.rows import other_sample_time, step_repair
from msnn.features.data_check.channels import RowsOfData
from msnn.features.data_check.errors import checks as errors
from msnn.features.data_check.found import CheckedChannel, DatasetCheck
from msnn.features.data_check.signals.plausible_units import doubt
from msnn.features.data_check.signals.quantisation import FEW_LEVELS
from msnn.model.model import Model
from spec_schema.diagnostics.diagnostic import Diagnostic

_COARSE = 0.01
"""Rounding error relative to the standard deviation that visibly reduces `fit`."""
_LITTLE = 0.1
"""Fraction of a declared range; data that cover less contain little about the range."""


def sampling_findings(
    model: Model, checked: DatasetCheck, *, resampled: bool
) -> Iterator[Diagnostic]:
    """Reports uneven sampling of every file, and sample times that differ from the spec."""
    expected = model.program.sample_time
    for found in checked.sampling:
        if found.repeated or found.backward:
            wrong = found.backward or found.repeated
            # backward rows are the worse fault: they are told first
            yield errors.repeated_times(
                file=found.file, count=len(wrong), row=wrong[0], backward=bool(found.backward)
            )
        if expected is None or not np.isfinite(found.step):
            continue
        if abs(found.step - expected) > GAP_TOLERANCE * expected and not resampled:
            time = found.time_unit
            repair = step_repair(
                found.step,
                expected,
                rows=found.rows * found.every,
                every=found.every,
                column=None if time is None else time.column,
                unit=None if time is None else time.unit,
            )
            yield other_sample_time(
                file=found.file, found=found.step, expected=expected, repair=repair
            )
        if found.gaps:
            yield errors.gaps_in_time(
                file=found.file,
                count=len(found.gaps),
                longest=found.longest,
                row=found.longest_row,
            )
        # uneven steps are what resampling is for
        if found.worst > GAP_TOLERANCE and not resampled:
            yield errors.uneven_steps(
                file=found.file,
                step=found.step,
                jitter=found.jitter,
                worst=found.worst,
                row=found.worst_row,
            )


def signal_findings(checked: DatasetCheck) -> Iterator[Diagnostic]:
    """Reports faults in the values of every column."""
    for one in checked.channels:
        # a column without any value is told once, not by each check
        if one.found.missing == one.found.rows:
            if one.found.rows:
                yield errors.constant_signal(
                    signal=one.channel.name, value=None, unit="", where=_files(checked.rows)
                )
            continue
        yield from _values(one, checked.rows)
        yield from _constant(one, checked.rows)


def _values(one: CheckedChannel, rows: RowsOfData) -> Iterator[Diagnostic]:
    channel, found = one.channel, one.found
    name, unit, signal = channel.name, channel.unit, channel.signal
    if found.missing:
        yield errors.missing_values(
            signal=name,
            count=found.missing,
            rows=found.rows,
            place=rows.place(found.first_missing),
            longest=found.longest_missing,
            is_input=signal.role is Role.INPUT,
        )
    if len(found.spikes):
        highest = int(np.argmax(found.spikes.heights))
        yield errors.spikes_found(
            signal=name,
            count=len(found.spikes),
            height=float(found.spikes.heights[highest]),
            unit=channel.difference_unit,
            place=rows.place(int(found.spikes.rows[highest])),
        )
    for limit in found.saturations:
        yield errors.stays_at_limit(
            signal=name,
            side=limit.side,
            value=limit.value,
            unit=unit,
            rows=limit.rows,
            longest=limit.longest,
            place=rows.place(limit.first),
        )
    grid = found.quantisation
    # few levels are switched: their steps are what somebody chose
    if grid is not None and grid.levels > FEW_LEVELS and grid.share > _COARSE:
        yield errors.coarse_steps(
            signal=name,
            step=grid.step,
            unit=channel.difference_unit,
            levels=grid.levels,
            bits=grid.bits,
            share=grid.share,
        )
    if (found_doubt := doubt(signal.unit, found.low, found.high)) is not None:
        rather, reason = found_doubt
        yield errors.doubtful_unit(
            signal=name,
            unit=unit.strip(),
            low=found.low,
            high=found.high,
            rather=rather,
            reason=reason,
        )
    if signal.range is not None and found.low < found.high:
        least, most = signal.range
        # how much of the declared range was seen; below 0 it lies outside, which reading has said
        share = (min(found.high, most) - max(found.low, least)) / (most - least)
        if 0 <= share < _LITTLE:
            yield errors.little_of_range(
                signal=name,
                low=found.low,
                high=found.high,
                least=least,
                most=most,
                unit=unit,
                share=share,
            )


def _constant(one: CheckedChannel, rows: RowsOfData) -> Iterator[Diagnostic]:
    """Reports a constant series, in all recordings or in some of several."""
    values = one.channel.values
    still: list[tuple[str, float]] = []
    # a signal may stand still in one record of several
    for record in rows.records:
        part = values[record.start : record.stop]
        known = part[np.isfinite(part)]
        if len(known) > 1 and np.ptp(known) == 0:
            still.append((record.file, float(known[0])))
    if not still:
        return
    where = still[0][0]
    if len(still) > 1:
        where += f" and {len(still) - 1} more"
    yield errors.constant_signal(
        signal=one.channel.name, value=still[0][1], unit=one.channel.unit, where=where
    )


def _files(rows: RowsOfData) -> str:
    files = [record.file for record in rows.records]
    return files[0] if len(files) == 1 else f"{files[0]} and {len(files) - 1} more"
