"""Draws validations: errors along samples, their correlations, and their growth."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from msnn.reports import plotting
from msnn.reports.drawn import unit_of, with_unit
from msnn.validation.measurement import Measurement
from msnn.validation.reports.words import measured_as
from msnn.validation.validate import MetricRow, ValidationReport

_MOST_INPUTS = 3


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
    drawn = every[: _MOST_INPUTS + 1]
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
