"""Draws simulations; the only place that needs matplotlib, which is an optional extra."""

from __future__ import annotations

import importlib.util
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from backends.atomic_write import replacing
from compiler.program import Program
from msnn.failures import MissingExtraError
from msnn.simulation import Simulation

_MOST_RUNS = 4
FORMATS = ("png", "svg", "pdf")


def require_plotting() -> None:
    """Raises MissingExtraError where matplotlib is not installed."""
    if importlib.util.find_spec("matplotlib") is None:
        raise MissingExtraError("matplotlib, which draws plots,", "pip install 'msnn[plot]'")


def plot_simulation(path: Path, program: Program, runs: Sequence[Simulation]) -> Path:
    """Draws every output over time with what was measured: an axis an output, a colour a run.

    The first four runs are drawn. Vector outputs show their first element. The name's ending says
    the format, one of FORMATS.
    """
    require_plotting()
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure: Any = Figure(figsize=(9, 2.6 * max(len(program.outputs), 1)), layout="constrained")
    FigureCanvasAgg(figure)
    axes: Any = figure.subplots(len(program.outputs), 1, squeeze=False, sharex=True)[:, 0]
    step = program.sample_time or 1.0
    for axis, output in zip(axes, program.outputs, strict=True):
        for run in runs[:_MOST_RUNS]:
            values = run.outputs[output.name]
            time = (run.first + np.arange(len(values))) * step
            (line,) = axis.plot(time, values.reshape(len(values), -1)[:, 0], label=run.record.file)
            if output.name in run.logged:
                logged = run.logged[output.name].reshape(len(values), -1)[:, 0]
                axis.plot(time, logged, ".", markersize=2, color=line.get_color(), alpha=0.6)
        unit = program.step[output.node].type.unit
        axis.set_ylabel(output.name if unit is None else f"{output.name} / {unit.text}")
        axis.grid(alpha=0.3)
    axes[-1].set_xlabel("time / s" if program.sample_time else "row")
    axes[0].legend(fontsize="small", title="line: simulated, dots: measured")
    with replacing(path) as temporary:
        figure.savefig(temporary, format=path.suffix.removeprefix("."), dpi=120)
    return path
