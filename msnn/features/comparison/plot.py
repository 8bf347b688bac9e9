"""Draws a comparison: accuracy on held-out rows against the cost of a step."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from msnn.features.comparison.compare import Comparison
from msnn.reports.plotting import COLORS, new_figure, saved_figure


def plot_comparison(path: Path, found: Comparison) -> Path:
    """One point per model, with standard deviation over seeds and folds; the Pareto front as line.

    The suffix selects the format, one of FORMATS.
    """
    figure = new_figure(2)
    axis: Any = figure.subplots()
    shown = [entry for entry in found.entries if not math.isnan(entry.score)]
    are_apart = len({entry.expense for entry in shown}) > 1  # labels of one column hide each other
    for entry in shown:
        deviation = None if math.isnan(entry.deviation) else entry.deviation
        color = COLORS[1] if entry.is_on_front else COLORS[0]
        axis.errorbar(
            entry.expense,
            entry.score,
            yerr=deviation,
            marker="o",
            color=color,
            capsize=3,
            zorder=4 if entry.is_on_front else 3,
        )
        if entry.is_on_front or (len(shown) <= 12 and are_apart):
            axis.annotate(
                entry.variant.label.replace("$", r"\$"),
                (entry.expense, entry.score),
                xytext=(5, 5),
                textcoords="offset points",
                fontsize="small",
            )
    # from cheap to dear: the order of the table would fold the line back
    front = sorted((e.expense, e.score) for e in shown if e.is_on_front)
    axis.plot([x for x, _ in front], [y for _, y in front], color=COLORS[1], label="Pareto front")
    counted = any(not math.isnan(entry.instructions) for entry in shown)
    axis.set_xlabel("instructions of a step" if counted else "learned numbers")
    axis.set_ylabel(found.criterion.heading.replace("$", r"\$"))
    axis.grid(alpha=0.3)
    axis.legend(fontsize="small")
    return saved_figure(figure, path)
