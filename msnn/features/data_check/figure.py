"""Draws a check of data: each column with findings, each response with its band."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from msnn.data.dataset import FloatArray
from msnn.features.data_check.found import CheckedChannel, CheckedSystem, DataCheck, DatasetCheck
from msnn.reports.drawn import unit_of, with_unit
from msnn.reports.plotting import (
    COLORS,
    ERROR,
    LIMIT,
    MEASURED,
    new_figure,
    saved_figure,
)

_MOST_POINTS = 4000
_LINES = 1024
_MOST_ROWS = 40
"""Maximum rows of plots of each kind, because images have at most 65,536 px per side."""


def plot_data_check(path: Path, check: DataCheck) -> Path:
    """Draws one row per column (values, findings, spectrum), then one row per pair.

    Columns are those of the first data section; at most forty columns and pairs are drawn. The
    suffix selects the format.
    """
    dataset = check.datasets[0]
    system = check.system
    channels, pairs = dataset.channels[:_MOST_ROWS], _pairs(system)[:_MOST_ROWS]
    figure = new_figure(len(channels) + len(pairs))
    axes: Any = figure.subplots(len(channels) + len(pairs), 2, squeeze=False)
    step = None if system is None else system.step
    for row, one in zip(axes, channels, strict=False):
        _values(row[0], one, dataset)
        _spectrum(row[1], one, step)
    for row, (target, number) in zip(axes[len(channels) :], pairs, strict=True):
        assert system is not None
        _response(row, system, target, number)
    return saved_figure(figure, path)


def _pairs(system: CheckedSystem | None) -> list[tuple[int, int]]:
    if system is None:
        return []
    return [
        (target, number)
        for target, one in enumerate(system.targets)
        if one.found.responses is not None
        for number in range(len(system.inputs))
    ]


def _values(axis: Any, one: CheckedChannel, dataset: DatasetCheck) -> None:
    """The series over the rows of all recordings, thinned to local minima and maxima."""
    values = one.channel.values
    rows, shown = _thinned(values)
    axis.plot(rows, shown, color=COLORS[0], linewidth=0.7)
    found = one.found
    if len(found.spikes):
        places = found.spikes.rows[:_MOST_POINTS]
        axis.plot(places, values[places], "x", color=ERROR, label="spike")
    for limit in found.saturations:
        axis.axhline(limit.value, color=LIMIT, linewidth=0.8, label=f"stays at its {limit.side}")
    lacks = np.flatnonzero(~np.isfinite(values))[:_MOST_POINTS]
    if len(lacks) and len(rows):
        low = np.nanmin(values) if np.isfinite(values).any() else 0.0
        axis.plot(lacks, np.full(len(lacks), low), "|", color=COLORS[4], label="missing")
    for record in dataset.rows.records[1:100]:
        axis.axvline(record.start, color="black", linewidth=0.4, alpha=0.5)
    axis.set_ylabel(with_unit(one.channel.name, unit_of(one.channel.signal.unit)))
    axis.set_xlabel("row of all records")
    axis.grid(alpha=0.3)
    if axis.get_legend_handles_labels()[0]:
        axis.legend(fontsize="small")


def _thinned(values: FloatArray) -> tuple[FloatArray, FloatArray]:
    rows = np.arange(len(values), dtype=np.float64)
    # lowest and highest of neighbours: a spike of one row stays visible
    size = len(values) // (_MOST_POINTS // 2)
    if size < 2:
        return rows, values
    count = len(values) // size
    table = values[: count * size].reshape(count, size)
    known = np.isfinite(table)
    low = np.where(known, table, np.inf).min(axis=1)
    high = np.where(known, table, -np.inf).max(axis=1)
    both = np.stack((low, high), axis=1).ravel()
    both[~np.isfinite(both)] = np.nan
    return np.repeat(rows[: count * size : size], 2), both


def _spectrum(axis: Any, one: CheckedChannel, step: float | None) -> None:
    """The mean spectrum of windows without missing values."""
    values = one.channel.values
    size = min(_LINES, len(values))
    window = np.hanning(size + 2)[1:-1]
    power, count = np.zeros(size // 2 + 1), 0
    for first in range(0, len(values) - size + 1, max(size // 2, 1)):
        # windows with missing values are left out: filled ones would have a spectrum of their own
        part = values[first : first + size]
        if np.isfinite(part).all():
            power += np.abs(np.fft.rfft(window * (part - part.mean()))) ** 2
            count += 1
    if count and np.any(power[1:] > 0):
        frequencies = np.fft.rfftfreq(size, 1.0 if step is None else step)
        # a logarithm shows no 0
        least = 1e-12 * power.max()
        axis.semilogy(
            frequencies[1:],
            np.maximum(power[1:], least) / power.max(),
            color=COLORS[0],
            linewidth=0.8,
        )
    axis.set_xlabel("1/row" if step is None else "frequency / Hz")
    axis.set_ylabel("power")
    axis.grid(alpha=0.3)


def _response(row: Any, system: CheckedSystem, target: int, number: int) -> None:
    """The impulse response with its band, and the step response."""
    one, channel = system.targets[target], system.inputs[number]
    found = one.found.responses
    assert found is not None
    lags = np.arange(found.lags)
    values, band = found.values[number], found.factor * found.errors[number]
    row[0].fill_between(lags, -band, band, color=MEASURED, alpha=0.3, label="none (99 %)")
    row[0].plot(lags, values, ".-", color=COLORS[0], markersize=3, linewidth=0.8)
    delay = one.found.delays[number]
    if delay is not None:
        row[0].axvline(delay, color=ERROR, linewidth=0.8, label=f"delay {delay}")
    row[0].set_title(f"{channel.name} → {one.channel.name}", fontsize="medium", loc="left")
    row[0].set_ylabel("impulse response")
    row[1].plot(lags * system.step, np.cumsum(values), color=COLORS[0], linewidth=0.8)
    row[1].set_ylabel("step response")
    row[0].set_xlabel("lag / rows")
    row[1].set_xlabel("time / s")
    row[0].legend(fontsize="small")
    for axis in row:
        axis.grid(alpha=0.3)
