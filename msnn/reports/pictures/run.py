"""Draws a run: its losses over epochs, and its learned functions."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from msnn.reports import plotting
from msnn.reports.learned_functions import MOST_FUNCTIONS, LearnedFunction
from msnn.training.records.progress import EpochEnd


def plot_run(
    path: Path, stages: Sequence[Sequence[EpochEnd]], functions: Sequence[LearnedFunction]
) -> Path:
    """Draws loss and monitor of every stage that has begun, then two functions per row."""
    left_out, functions = functions[MOST_FUNCTIONS:], functions[:MOST_FUNCTIONS]
    rows = len(stages) + (len(functions) + 1) // 2
    figure = plotting.new_figure(rows)
    grid: Any = figure.add_gridspec(max(rows, 1), 2)
    for number, epochs in enumerate(stages):
        _draw_losses(figure.add_subplot(grid[number, :]), epochs)
    for number, function in enumerate(functions):
        place = grid[len(stages) + number // 2, number % 2]
        _draw_function(figure.add_subplot(place), function)
    if left_out:
        said = f"not drawn: {', '.join(plotting.plain_text(each.title) for each in left_out[:4])}"
        said += f" and {len(left_out) - 4} more" if len(left_out) > 4 else ""
        figure.supxlabel(said, fontsize="small", x=0.01, ha="left")
    return plotting.saved_figure(figure, path)


def _draw_losses(axis: Any, epochs: Sequence[EpochEnd]) -> None:
    """The weighted total and the monitor over the epochs of a stage."""
    numbers = [event.epoch for event in epochs]
    color, other = plotting.COLORS[:2]
    totals = [event.total for event in epochs]
    axis.plot(numbers, totals, color=color, label="loss, training")
    axis.plot(numbers, [event.monitor for event in epochs], color=other, label="monitor")
    axis.axvline(epochs[-1].best_epoch, color="black", linewidth=0.8, label="best")
    if all(event.total > 0 and event.monitor > 0 for event in epochs):
        axis.set_yscale("log")
    axis.set_title(plotting.plain_text(epochs[-1].stage), fontsize="medium", loc="left")
    axis.set_xlabel("epoch")
    axis.grid(alpha=0.3)
    plotting.legend_above(axis)


def _draw_function(axis: Any, function: LearnedFunction) -> None:
    for curve, color in zip(function.curves, plotting.COLORS, strict=False):
        label = plotting.plain_text(curve.label)
        if function.is_taps and len(function.curves) == 1:
            axis.vlines(function.x, 0.0, curve.y, color=color, linewidth=1.0)
            axis.plot(function.x, curve.y, "o", markersize=3.5, color=color)
            axis.axhline(0.0, color="black", linewidth=0.6)
        else:
            axis.plot(function.x, curve.y, color=color, label=label)
    title = plotting.plain_text(function.titled(len(plotting.COLORS)))
    axis.set_title(title, fontsize="medium", loc="left")
    axis.set_xlabel(plotting.plain_text(function.x_label))
    axis.set_ylabel(plotting.plain_text(function.y_label))
    axis.grid(alpha=0.3)
    if len(function.curves) > 1:
        axis.legend(fontsize="x-small")
