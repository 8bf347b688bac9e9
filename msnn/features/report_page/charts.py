"""Builds the charts of the page: errors, rollouts, training, learned functions."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from msnn.data.dataset import FloatArray
from msnn.features.report_page.packing import Plain, listed, packed
from msnn.reports.drawn import unit_of, with_unit
from msnn.reports.learned_functions import LearnedFunction
from msnn.reports.run_summary import Run, TrainedStage
from msnn.validation.measurement import Measurement
from msnn.validation.reports.words import measured_as
from msnn.validation.statistics.correlations import Correlation
from msnn.validation.validate import MetricRow

_COLORS = 7
"""Number of curve colours in the page's style."""
_MOST_INPUTS = 4
MOST_MEASUREMENTS = 8


def color_of(number: int) -> str:
    """The CSS class of the colour of curve `number`; colours repeat after `_COLORS` curves."""
    return f"c{number % _COLORS + 1}"


def error_charts(
    measurements: Sequence[Measurement], rows: Sequence[MetricRow]
) -> Iterator[tuple[str, Plain]]:
    """Titles and charts for the first `MOST_MEASUREMENTS` measurements: correlations of the errors,
    and their growth along rollouts. `rows` are the metrics of the spec, whose limits are drawn.
    """
    for found in measurements[:MOST_MEASUREMENTS]:
        title = ", ".join(measured_as(found))
        correlations = _correlations(found)
        if correlations is not None:
            yield f"Errors of {title}: are they noise?", correlations
        if found.curve is not None:
            yield f"Errors of {title}: how they grow", _growth(found, rows)


def _correlations(found: Measurement) -> Plain | None:
    """A chart of the correlations of the errors with themselves and with at most `_MOST_INPUTS`
    inputs, each with the band in which 99 % of the correlations of noise lie.

    Only the first element of a vector is drawn. None if its autocorrelation is unknown.
    """
    # of a vector the first number; how many more there are stands in the note
    first = found.judged.residuals[0]
    if first.itself is None:
        return None
    each = [("themselves", first.itself), *list(first.inputs.items())[:_MOST_INPUTS]]
    # `each` has the errors themselves as well
    hidden = len(first.inputs) + 1 - len(each)
    elements = len(found.judged.residuals) - 1
    note = "Shaded: where 99 % of the correlations of noise lie."
    return {
        "label": f"Correlation of the errors of {found.of} with themselves and with inputs",
        "xlabel": "lag / samples",
        "padded": True,
        "note": note
        + (f" {hidden} more inputs are not drawn." if hidden else "")
        + (f" {elements} more numbers of {found.of} are not drawn." if elements else ""),
        "panels": [
            {
                "label": f"with {name}",
                "height": 120,
                "zero": True,
                "lines": [{"y": 0, "solid": True, "color": "muted"}],
                "series": _in_band(name, correlation, number),
            }
            for number, (name, correlation) in enumerate(each)
        ],
    }


def _in_band(name: str, found: Correlation, number: int) -> list[Plain]:
    # half a lag beyond the outermost stems: the band is seen to hold for them too
    ends = np.array([found.lags[0] - 0.5, *found.lags[1:-1], found.lags[-1] + 0.5])
    color = color_of(number)
    band = found.bands
    return [
        {
            "name": "noise",
            "unlisted": True,
            "color": color,
            "x": listed(ends),
            "low": listed(-band),
            "high": listed(band),
        },
        {
            "name": f"with {name}",
            "kind": "stem",
            "color": color,
            "x": {"start": int(found.lags[0]), "step": 1},
            "y": listed(found.values),
        },
    ]


def _growth(found: Measurement, rows: Sequence[MetricRow]) -> Plain:
    curve = found.curve
    assert curve is not None
    own = [row for row in rows if measured_as(row) == measured_as(found)]
    limits = [
        {"y": row.maximum, "label": "limit of the mean", "far": True}
        for row in own
        # the limit is one of the rmse over all steps, drawn beside those of single steps
        if row.metric == "rmse" and row.maximum is not None
    ]
    return {
        "label": f"Root mean square error of {found.of} along its rollouts",
        "xlabel": "step of the rollout",
        "padded": True,
        "panels": [
            {
                "label": with_unit("rmse", unit_of(found.unit)),
                "height": 190,
                "zero": True,
                "lines": limits,
                "series": [
                    {
                        "name": f"rmse of {found.of}",
                        "color": "simulated",
                        "x": listed((curve.first + curve.last) / 2),
                        "y": listed(curve.rmse),
                    }
                ],
            }
        ],
    }


def training_charts(run: Run) -> Iterator[tuple[str, Plain]]:
    """Yields a title and a chart of training loss and monitor over epochs, for each stage with more
    than one epoch.
    """
    for stage in run.stages:
        if len(stage.epochs) > 1:
            yield f"Stage {stage.reached.stage}", _losses(stage)


def _losses(stage: TrainedStage) -> Plain:
    epochs = np.array([event.epoch for event in stage.epochs], np.float64)
    total = np.array([event.total for event in stage.epochs])
    monitor = np.array([event.monitor for event in stage.epochs])
    best = stage.reached.best_epoch
    return {
        "label": f"Loss and monitor over the epochs of stage {stage.reached.stage}",
        "xlabel": "epoch",
        "padded": True,
        "x": packed(epochs),
        "panels": [
            {
                "label": "loss",
                "height": 200,
                # log-likelihoods and fits of less than nothing have signs
                "log": _positive(total) and _positive(monitor),
                "lines": [{"x": best, "label": "best", "color": "muted"}],
                "series": [
                    {"name": "loss, training", "color": "c1", "y": packed(total)},
                    {"name": "monitor", "color": "c2", "y": packed(monitor)},
                ],
            }
        ],
    }


def _positive(values: FloatArray) -> bool:
    known = values[np.isfinite(values)]
    return len(known) > 0 and bool((known > 0).all())


def function_charts(functions: Sequence[LearnedFunction]) -> Iterator[tuple[str, Plain]]:
    """Yields a title and a chart for each learned function."""
    for function in functions:
        yield function.titled(len(function.curves)), _chart(function)


def _chart(function: LearnedFunction) -> Plain:
    panel: Plain = {
        "label": function.y_label,
        "height": 190,
        "series": [
            {
                "name": curve.label,
                "color": color_of(number),
                "y": listed(curve.y) if function.is_taps else packed(curve.y),
                "wide": True,
                **({"kind": "stem"} if function.is_taps and len(function.curves) == 1 else {}),
            }
            for number, curve in enumerate(function.curves)
        ],
    }
    if function.is_taps:
        panel |= {"zero": True, "lines": [{"y": 0, "solid": True, "color": "muted"}]}
    return {
        "label": f"Learned function {function.title}",
        "xlabel": function.x_label,
        "padded": True,
        "x": listed(function.x) if function.is_taps else packed(function.x),
        "panels": [panel],
    }
