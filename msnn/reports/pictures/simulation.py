"""Draws simulations: measured and simulated values, errors, inputs, correlation of errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from textwrap import fill
from typing import Any

import numpy as np

from compiler.ir.program import Program, Role
from msnn.data.dataset import FloatArray
from msnn.reports import plotting
from msnn.reports.drawn import DrawnNumber, channels, output_channels, shown_first, with_unit
from msnn.simulation.simulate import Simulation
from msnn.validation.statistics.correlations import Correlation, lags_of, residuals
from msnn.validation.statistics.metrics import Errors, score

_MOST_RUNS = 3
_MOST_OUTPUTS = 4
_MOST_INPUTS = 4
_LETTERS = 15
"""Characters of small print per inch."""
_LEGEND_HEIGHT = 20.0
"""Points between an axis and the text above its legend."""


def plot_simulation(path: Path, program: Program, runs: Sequence[Simulation]) -> Path:
    """Draws one column per run, test set first; the suffix of `path` selects the format.

    Each output has its measurements and simulation with fit and RMSE, dashed range limits, shaded
    prediction intervals, and its error. Below are the inputs, and the autocorrelation of errors
    with the band of noise. Omitted contents are named.
    """
    shown = shown_first(runs)[:_MOST_RUNS]
    every_output, every_input = output_channels(program), _inputs(program, shown)
    outputs, inputs = every_output[:_MOST_OUTPUTS], every_input[:_MOST_INPUTS]
    far = _far_limits(shown, (*outputs, *inputs))
    outputs, inputs = (
        [_with_near_limits(channel, shown) for channel in drawn] for drawn in (outputs, inputs)
    )
    compared = [channel for channel in outputs if channel.predicts is not None]
    heights = [h for c in outputs for h in ((2.2, 1.0) if c in compared else (2.2,))]
    heights += [1.0] * len(inputs) + [1.2] * len(compared)
    figure = plotting.new_figure(0)
    figure.set_size_inches(max(9.0, 6.0 * len(shown)), 1.0 + 1.05 * sum(heights))
    axes: Any = figure.subplots(
        len(heights), len(shown), squeeze=False, gridspec_kw={"height_ratios": heights}
    )
    timed = all(run.places.time is not None for run in shown)
    for column, run in zip(axes.T, shown, strict=True):
        along = run.places.along(timed=timed)
        _draw_run(list(column), program, run, along, outputs, inputs)
        last = len(heights) - len(compared) - 1
        for axis in column[:last]:
            axis.tick_params(labelbottom=False)
        column[last].set_xlabel("time / s" if timed else "row of the file")
    left_out = _left_out(len(runs) - len(shown), program, len(outputs), len(inputs), shown)
    left_out += far
    if left_out:
        said = plotting.plain_text(f"not drawn: {', '.join(left_out)}")
        said = fill(said, int(_LETTERS * figure.get_figwidth()))
        figure.supxlabel(said, fontsize="small", x=0.01, ha="left")
    return plotting.saved_figure(figure, path)


def _inputs(program: Program, shown: Sequence[Simulation]) -> list[DrawnNumber]:
    read = {name for run in shown for name in run.inputs}
    return channels([s for s in program.signals if s.role is Role.INPUT and s.name in read])


def _left_out(
    runs: int, program: Program, outputs: int, inputs: int, shown: Sequence[Simulation]
) -> list[str]:
    """Texts about omitted runs and elements."""
    every = sum(program.step[output.node].type.size for output in program.outputs)
    read = sum(values[0].size for run in shown[:1] for values in run.inputs.values())
    missing = [
        (runs, "runs"),
        (every - outputs, "numbers of outputs"),
        (read - inputs, "numbers of inputs"),
    ]
    return [f"{count} {what}" for count, what in missing if count > 0]


def _far_limits(shown: Sequence[Simulation], drawn: Sequence[DrawnNumber]) -> list[str]:
    """Range limits that are far from all values; drawing them would flatten the curves."""
    found: list[str] = []
    for channel in drawn:
        texts = [f"{end:g} {channel.unit}".strip() for end in _ends(channel, shown)[1]]
        if texts:
            found.append(f"far limits of {channel.name}: {' and '.join(texts)}")
    return found


def _with_near_limits(channel: DrawnNumber, shown: Sequence[Simulation]) -> DrawnNumber:
    """The channel without distant range limits, equal for all runs."""
    near = _ends(channel, shown)[0]
    low = channel.low if channel.low in near else None
    return replace(channel, low=low, high=channel.high if channel.high in near else None)


def _ends(channel: DrawnNumber, shown: Sequence[Simulation]) -> tuple[list[float], list[float]]:
    """Limits of the declared range: those near the drawn values, and distant ones."""
    declared = [end for end in (channel.low, channel.high) if end is not None]
    values = np.concatenate([_values(run, channel) for run in shown] or [np.empty(0)])
    known = values[np.isfinite(values)]
    if not len(known):
        return [], declared
    low, high = float(known.min()), float(known.max())
    room = 0.6 * (high - low)
    near = [end for end in declared if low - room <= end <= high + room]
    return near, [end for end in declared if end not in near]


def _values(run: Simulation, channel: DrawnNumber) -> FloatArray:
    """All drawn values of an element in one run."""
    if channel.source in run.inputs:
        return channel.of(run.inputs[channel.source])
    values = channel.of(run.outputs[channel.source])
    if channel.source not in run.logged:
        return values
    return np.concatenate((values, channel.of(run.logged[channel.source])))


def _draw_run(
    axes: list[Any],
    program: Program,
    run: Simulation,
    along: FloatArray,
    outputs: Sequence[DrawnNumber],
    inputs: Sequence[DrawnNumber],
) -> None:
    first = axes[0]
    first.set_title(_name(run), fontsize="medium", loc="left", pad=_LEGEND_HEIGHT + 16.0)
    correlations: list[tuple[DrawnNumber, Correlation | None]] = []
    for channel in outputs:
        axis = axes.pop(0)
        _draw_output(axis, run, along, channel)
        if axis is not first:
            axis.sharex(first)
        if channel.predicts is None:
            continue
        below = axes.pop(0)
        below.sharex(first)
        found = _draw_error(below, program, run, along, channel)
        correlations.append((channel, found))
    for channel in inputs:
        axis = axes.pop(0)
        axis.sharex(first)
        values = channel.of(run.inputs[channel.source])
        axis.plot(along, values, color=plotting.INPUT, linewidth=1.0)
        _finish(axis, channel.name, channel.unit)
        _draw_limits(axis, channel)
    for axis, (channel, found) in zip(axes, correlations, strict=True):
        _draw_correlation(axis, channel, found)


def _name(run: Simulation) -> str:
    sets = ", ".join(name or "no set" for name in dict.fromkeys(run.places.sets))
    return plotting.plain_text(f"{run.record.file}, {sets}" if sets else run.record.file)


def _draw_output(axis: Any, run: Simulation, along: FloatArray, channel: DrawnNumber) -> None:
    values = channel.of(run.outputs[channel.source])
    if channel.source in run.logged:
        measured = channel.of(run.logged[channel.source])
        plotting.draw_line(
            axis, along, measured, color=plotting.MEASURED, linewidth=3.0, label="measured"
        )
        errors = Errors.of(values, measured)
        fit, rmse = score("fit", errors).value, score("rmse", errors).value
        figures = [f"fit {fit:.4g} %"] if np.isfinite(fit) else []
        figures += [f"rmse {rmse:.4g} {channel.error_unit}".strip()] if np.isfinite(rmse) else []
        # over the legend, which with limits and intervals is as wide as the axis
        axis.annotate(
            ", ".join(figures),
            (0.0, 1.0),
            xycoords="axes fraction",
            xytext=(0.0, _LEGEND_HEIGHT),
            textcoords="offset points",
            fontsize="small",
            va="bottom",
        )
    axis.plot(along, values, color=plotting.SIMULATED, linewidth=1.3, label="simulated")
    if channel.source in run.bands:
        half = channel.of(run.bands[channel.source])
        axis.fill_between(
            along,
            values - half,
            values + half,
            color=plotting.SIMULATED,
            alpha=0.2,
            linewidth=0,
            label="prediction interval",
        )
    _finish(axis, channel.name, channel.unit)
    _draw_limits(axis, channel)
    plotting.legend_above(axis)


def _draw_limits(axis: Any, channel: DrawnNumber) -> None:
    for end in (channel.low, channel.high):
        if end is not None:
            axis.axhline(end, color=plotting.LIMIT, linestyle="--", linewidth=0.9, label="limit")


def _draw_error(
    axis: Any, program: Program, run: Simulation, along: FloatArray, channel: DrawnNumber
) -> Correlation | None:
    if channel.source not in run.logged:
        axis.set_axis_off()
        return None
    error = channel.of(run.outputs[channel.source]) - channel.of(run.logged[channel.source])
    plotting.draw_line(axis, along, error, color=plotting.ERROR, linewidth=0.9)
    axis.axhline(0.0, color="black", linewidth=0.6)
    _finish(axis, "error", channel.error_unit)
    rows = np.arange(len(error), dtype=np.int64)
    (found,) = residuals(error, rows, np.zeros_like(rows), {}, lags_of(program.sample_time))
    return found.itself


def _draw_correlation(axis: Any, channel: DrawnNumber, found: Correlation | None) -> None:
    """Draws a correlation with the band that contains 99 % of the values for noise."""
    if found is None:
        axis.set_axis_off()
        said = f"too few samples to judge the errors of {channel.name}"
        axis.text(0.0, 0.5, said, fontsize="small", transform=axis.transAxes)
        return
    band = {"color": plotting.ERROR, "alpha": 0.15, "linewidth": 0}
    axis.fill_between(found.lags, -found.bands, found.bands, **band)
    axis.vlines(found.lags, 0.0, found.values, color=plotting.ERROR, linewidth=1.2)
    axis.axhline(0.0, color="black", linewidth=0.6)
    axis.set_xlabel(f"lag / samples: errors of {channel.name} with themselves, band: 99 % of noise")
    axis.set_ylabel("correlation")
    axis.grid(alpha=0.3)


def _finish(axis: Any, name: str, unit: str) -> None:
    axis.set_ylabel(with_unit(name, unit), fontsize="small")
    axis.grid(alpha=0.3)
