"""Draws simulations and validations: values, inputs, errors and their correlation."""

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
from msnn.reports.drawn import (
    DrawnNumber,
    channels,
    output_channels,
    shown_first,
    unit_of,
    with_unit,
)
from msnn.simulation.simulate import Simulation
from msnn.validation.measurement import Measurement
from msnn.validation.reports.words import measured_as
from msnn.validation.statistics.correlations import Correlation, lags_of, residuals
from msnn.validation.statistics.metrics import Errors, score
from msnn.validation.validate import MetricRow, ValidationReport

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
    """Phrases such as "3 runs" for what a plot leaves out.

    `runs` is the number of runs that were left out; of the elements of outputs and inputs the first
    `outputs` and `inputs` are drawn.
    """
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
    """The plotted values of an element in one run: simulated ones, then measured ones if there are
    any.
    """
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


_MOST_CORRELATED_INPUTS = 3


def plot_validation(path: Path, report: ValidationReport) -> Path:
    """Draws one row per measurement with fit and RMSE; limits of the spec are dashed.

    There are two columns if all rollouts have one step. For vector outputs, the correlations are
    those of the first element; omitted contents are named. The suffix selects the format, one of
    FORMATS.
    """
    measurements = report.measurements
    figure = plotting.new_figure(len(measurements))
    columns = 3 if any(found.curve is not None for found in measurements) else 2
    figure.set_figwidth(5.0 * columns)
    axes: Any = figure.subplots(max(len(measurements), 1), columns, squeeze=False)
    for row, found in zip(axes, measurements, strict=False):
        limits = [each for each in report.rows if measured_as(each) == measured_as(found)]
        _draw_errors(row[0], found, limits)
        _draw_correlations(row[1], found)
        if columns == 3:
            _draw_growth(row[2], found, limits)
    return plotting.saved_figure(figure, path)


def _draw_errors(axis: Any, found: Measurement, limits: Sequence[MetricRow]) -> None:
    trace = found.trace
    axis.fill_between(
        trace.sample, trace.low, trace.high, linewidth=0.8, color=plotting.ERROR, alpha=0.85
    )
    axis.axhline(0.0, color="black", linewidth=0.8)
    for row in limits:
        if row.metric == "max_abs" and row.maximum is not None:
            for end in (row.maximum, -row.maximum):
                axis.axhline(end, color=plotting.LIMIT, linestyle="--", linewidth=0.9)
    fit, rmse = found.metrics["fit"].value, found.metrics["rmse"].value
    figures = [f"fit {fit:.4g} %"] if np.isfinite(fit) else []
    figures.append(f"rmse {rmse:.4g} {unit_of(found.unit)}".strip())
    figures += [_limit_text(row) for row in limits if row.passed is not None]
    title = f"{', '.join(measured_as(found))}\n{', '.join(figures)}"
    axis.set_title(plotting.plain_text(title), fontsize="medium", loc="left")
    axis.set_xlabel("scored sample")
    axis.set_ylabel(with_unit(f"error of {found.of}", unit_of(found.unit)))
    axis.grid(alpha=0.3)


def _limit_text(row: MetricRow) -> str:
    low = [f"≥ {row.minimum:.4g}"] if row.minimum is not None else []
    high = [f"≤ {row.maximum:.4g}"] if row.maximum is not None else []
    return f"{row.metric} {' '.join(low + high)} {'kept' if row.passed else 'BROKEN'}"


def _draw_correlations(axis: Any, found: Measurement) -> None:
    """Draws the correlations of errors with themselves and with each input, with bands."""
    first = found.judged.residuals[0]
    if first.itself is None:
        axis.set_axis_off()
        return
    every = [("themselves", first.itself), *first.inputs.items()]
    drawn = every[: _MOST_CORRELATED_INPUTS + 1]
    for (name, each), color in zip(drawn, plotting.COLORS, strict=False):
        axis.plot(
            each.lags, each.values, ".-", markersize=3, linewidth=0.8, color=color, label=name
        )
        band = {"color": color, "alpha": 0.12, "linewidth": 0}
        axis.fill_between(each.lags, -each.bands, each.bands, **band)
    axis.axhline(0.0, color="black", linewidth=0.8)
    left_out = [f"{len(every) - len(drawn)} inputs"] if len(every) > len(drawn) else []
    elements = len(found.judged.residuals) - 1
    left_out += [f"{elements} elements of {found.of}"] if elements else []
    said = f"\nnot drawn: {', '.join(left_out)}" if left_out else ""
    axis.set_xlabel(f"lag / samples; band: 99 % of noise{said}")
    axis.set_ylabel("correlation of errors with")
    plotting.legend_above(axis)
    axis.grid(alpha=0.3)


def _draw_growth(axis: Any, found: Measurement, limits: Sequence[MetricRow]) -> None:
    """The RMSE over the steps of rollouts; the limit applies to the mean over all steps."""
    curve = found.curve
    if curve is None:
        axis.set_axis_off()
        return
    color = plotting.SIMULATED
    axis.plot((curve.first + curve.last) / 2, curve.rmse, ".-", markersize=3, color=color)
    for row in limits:
        if row.metric == "rmse" and row.maximum is not None:
            axis.axhline(
                row.maximum, color=plotting.LIMIT, linestyle="--", linewidth=0.9, label="limit"
            )
            plotting.legend_above(axis)
    axis.set_ylim(bottom=0.0)
    axis.set_xlabel("step of the rollout")
    axis.set_ylabel(with_unit("rmse", unit_of(found.unit)))
    axis.grid(alpha=0.3)
