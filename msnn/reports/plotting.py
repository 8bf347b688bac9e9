"""Draws simulations, validations and losses; only here matplotlib is needed, an optional extra."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from backends.files.atomic_write import replacing
from compiler.ir.program import Program
from msnn.packages import MATPLOTLIB
from msnn.simulation.simulate import Simulation
from msnn.training.records.progress import EpochEnd
from msnn.validation.measurement import Measurement
from msnn.validation.words import rollout_text
from spec_schema.units.unit import Unit

_MOST_RUNS = 4
FORMATS = ("png", "svg", "pdf")


def require_plotting() -> None:
    """Raises MissingExtraError where matplotlib is not installed."""
    MATPLOTLIB.require("draws plots")


def plot_simulation(path: Path, program: Program, runs: Sequence[Simulation]) -> Path:
    """Draws every output over time with what was measured: an axis an output, a colour a run.

    The first four runs are drawn, prediction intervals shaded. Vector outputs show their first
    element. The name's ending says the format, one of FORMATS.
    """
    figure = new_figure(len(program.outputs))
    axes: Any = figure.subplots(len(program.outputs), 1, squeeze=False, sharex=True)[:, 0]
    timed = all(run.places.time is not None for run in runs)
    several = len({name for run in runs for name in run.places.sets}) > 1
    for axis, output in zip(axes, program.outputs, strict=True):
        for run in runs[:_MOST_RUNS]:
            values = run.outputs[output.name]
            label = f"{run.record.file}, {_sets(run)}" if several else run.record.file
            along = run.places.time if timed else run.places.rows
            (line,) = axis.plot(along, values.reshape(len(values), -1)[:, 0], label=label)
            if output.name in run.bands:
                middle, half = (
                    each.reshape(len(values), -1)[:, 0] for each in (values, run.bands[output.name])
                )
                color = line.get_color()
                axis.fill_between(along, middle - half, middle + half, color=color, alpha=0.2)
            if output.name in run.logged:
                logged = run.logged[output.name].reshape(len(values), -1)[:, 0]
                axis.plot(along, logged, ".", markersize=2, color=line.get_color(), alpha=0.6)
        axis.set_ylabel(quantity(output.name, program.step[output.node].type.unit))
        axis.grid(alpha=0.3)
    axes[-1].set_xlabel("time / s" if timed else "row of the file")
    axes[0].legend(fontsize="small", title="line: simulated, dots: measured")
    return saved_figure(figure, path)


def _sets(run: Simulation) -> str:
    return ", ".join(name or "no set" for name in dict.fromkeys(run.places.sets))


def plot_validation(path: Path, measurements: Sequence[Measurement]) -> Path:
    """Draws of every measurement the error along the scored samples, with what it correlates, and
    how it grows with steps.

    A row a measurement; without rollouts of several steps there are two columns. Of vector outputs
    the correlations are those of the first element. The name's ending says the format, one of
    FORMATS.
    """
    figure = new_figure(len(measurements))
    columns = 3 if any(found.curve is not None for found in measurements) else 2
    figure.set_figwidth(4.5 * columns)
    axes: Any = figure.subplots(len(measurements), columns, squeeze=False)
    for row, found in zip(axes, measurements, strict=True):
        trace, curve = found.trace, found.curve
        row[0].fill_between(trace.sample, trace.low, trace.high, linewidth=0.8, edgecolor="C0")
        row[0].axhline(0.0, color="black", linewidth=0.8)
        row[0].set_title(f"{rollout_text(found)}, {found.data}", fontsize="medium", loc="left")
        row[0].set_xlabel("scored sample")
        row[0].set_ylabel(quantity(f"error of {found.of}", found.unit))
        row[0].grid(alpha=0.3)
        _draw_correlations(row[1], found)
        if curve is not None:
            row[2].plot((curve.first + curve.last) / 2, curve.rmse, ".-", markersize=3)
            row[2].set_ylim(bottom=0.0)
            row[2].set_xlabel("step of the rollout")
            row[2].set_ylabel(quantity("rmse", found.unit))
            row[2].grid(alpha=0.3)
        elif columns == 3:
            row[2].set_axis_off()
    return saved_figure(figure, path)


def _draw_correlations(axis: Any, found: Measurement) -> None:
    """Of the errors with themselves and with each input, each in the band of noise."""
    first = found.judged.residuals[0]
    drawn = [] if first.itself is None else [("themselves", first.itself), *first.inputs.items()]
    if not drawn:
        axis.set_axis_off()
        return
    for number, (name, each) in enumerate(drawn[:_MOST_RUNS]):
        color = f"C{number}"
        axis.plot(
            each.lags, each.values, ".-", markersize=3, linewidth=0.8, color=color, label=name
        )
        axis.axhspan(-each.band, each.band, color=color, alpha=0.12, linewidth=0)
    axis.axhline(0.0, color="black", linewidth=0.8)
    axis.set_xlabel("lag / samples")
    axis.set_ylabel("correlation of errors")
    axis.legend(fontsize="small", title="with (band: 99 % of noise)", title_fontsize="small")
    axis.grid(alpha=0.3)


def plot_losses(path: Path, stages: Sequence[Sequence[EpochEnd]]) -> Path:
    """Draws the weighted total and the monitor over the epochs of every stage that has begun."""
    figure = new_figure(len(stages))
    axes: Any = figure.subplots(max(len(stages), 1), 1, squeeze=False)[:, 0]
    for axis, epochs in zip(axes, stages, strict=False):
        numbers = [event.epoch for event in epochs]
        axis.plot(numbers, [event.total for event in epochs], label="loss, training")
        axis.plot(numbers, [event.monitor for event in epochs], label="monitor")
        axis.axvline(epochs[-1].best_epoch, color="black", linewidth=0.8, label="best")
        if all(event.total > 0 and event.monitor > 0 for event in epochs):
            axis.set_yscale("log")
        axis.set_title(epochs[-1].stage, fontsize="medium", loc="left")
        axis.set_xlabel("epoch")
        axis.grid(alpha=0.3)
        axis.legend(fontsize="small")
    return saved_figure(figure, path)


def new_figure(rows: int) -> Any:
    """A figure that no window shows, `rows` axes high. MissingExtraError without matplotlib."""
    require_plotting()
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure: Any = Figure(figsize=(9, 2.6 * max(rows, 1)), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def saved_figure(figure: Any, path: Path) -> Path:
    """Writes it whole or not at all, in the format that the name ends with."""
    with replacing(path) as temporary:
        figure.savefig(temporary, format=path.suffix.removeprefix("."), dpi=120)
    return path


def quantity(name: str, unit: Unit | None) -> str:
    """A name with its unit, as axes have them."""
    return name if unit is None else f"{name} / {unit.text}"
