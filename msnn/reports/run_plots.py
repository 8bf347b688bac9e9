"""Draws a run: its losses over epochs, and the functions that it has learned."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from msnn.model.load import load_model
from msnn.model.model_data import read_data, sources_of
from msnn.model.saved_run import WEIGHTS
from msnn.model.weights.weights_file import read_weights
from msnn.reports import plotting
from msnn.reports.learned_functions import MOST_FUNCTIONS, LearnedFunction, learned_functions
from msnn.reports.run_summary import Run
from msnn.training.records.progress import EpochEnd
from spec_schema.diagnostics.diagnostic import SpecError


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


def functions_of_run(run: Run) -> tuple[LearnedFunction, ...]:
    """Functions over the range of the run's data, if available; empty without weights."""
    weights = run.folder / WEIGHTS
    if not weights.is_file():
        return ()
    # as the run has kept it: the file of the spec may have changed since
    model = load_model(run.folder)
    try:
        data = read_data(model, None, "picture")
    except SpecError:  # a run does not keep its data: taps need none
        data = None
    with sources_of(model):
        return learned_functions(model, read_weights(weights, model.program), data)
