"""Builds the charts of learned functions for the page."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from msnn.features.report_page.charts import color_of
from msnn.features.report_page.packing import Plain, listed, packed
from msnn.reports.learned_functions import LearnedFunction


def function_charts(functions: Sequence[LearnedFunction]) -> Iterator[tuple[str, Plain]]:
    """A title and a chart each."""
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
