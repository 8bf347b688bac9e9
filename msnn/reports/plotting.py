"""Makes figures without windows; only this module needs matplotlib, an optional extra."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from backends.files.atomic_write import replacing
from msnn.data.dataset import FloatArray
from msnn.packages import MATPLOTLIB

FORMATS = ("png", "svg", "pdf")

MEASURED, SIMULATED, ERROR, INPUT, LIMIT = "#8d98a5", "#0072b2", "#d55e00", "#009e73", "#b3266c"
COLORS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000")
"""Colours suitable for colour-blind readers (Okabe and Ito 2008)."""


def require_plotting() -> None:
    """Raises MissingExtraError if matplotlib is not installed."""
    MATPLOTLIB.require("draws plots")


def new_figure(rows: int) -> Any:
    """A figure without a window, with `rows` rows of axes. MissingExtraError without matplotlib."""
    require_plotting()
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure: Any = Figure(figsize=(9, 2.6 * max(rows, 1)), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def saved_figure(figure: Any, path: Path) -> Path:
    """Writes the figure atomically, in the format of the suffix."""
    with replacing(path) as temporary:
        figure.savefig(temporary, format=path.suffix.removeprefix("."), dpi=120)
    return path


def plain_text(text: str) -> str:
    """The text, escaped so that matplotlib finds no formulas."""
    return text.replace("$", r"\$")


def draw_line(axis: Any, along: FloatArray, values: FloatArray, **style: Any) -> None:
    """Draws a line, and dots for isolated values between gaps, which a line would not show."""
    axis.plot(along, values, **style)
    known = np.concatenate([[False], np.isfinite(values), [False]])
    lone = known[1:-1] & ~known[:-2] & ~known[2:]
    if lone.any():
        size = max(style["linewidth"], 2.0)
        axis.plot(along[lone], values[lone], "o", markersize=size, color=style["color"])


def legend_above(axis: Any) -> None:
    """Draws the legend in one line above the axis."""
    handles, labels = axis.get_legend_handles_labels()
    # both limits are one entry
    entries = dict(zip(labels, handles, strict=True))
    axis.legend(
        list(entries.values()),
        list(entries),
        fontsize="small",
        ncols=4,
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        borderaxespad=0.2,
        frameon=False,
    )
