"""Shows comparisons: accuracy of models on held-out rows, and the cost of a step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from msnn.api.results.shown import Shown
from msnn.features.comparison.compare import Comparison
from msnn.features.comparison.plot import plot_comparison
from msnn.features.comparison.table import comparison_cells, comparison_record
from msnn.tables import Table, count


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class ShownComparison(Shown, Comparison):
    """A comparison with its table; `to_frame` returns the values."""

    def _said(self) -> str:
        best = "none trained" if self.best is None else f"best {self.best.variant.label}"
        models = count(len(self.entries), "model")
        return f"Comparison: {models} by {self.criterion.heading}, {best}"

    def _tables(self) -> Sequence[Table]:
        return [comparison_cells(self)]

    def _columns(self) -> Mapping[str, Sequence[object]]:
        rows: list[dict[str, Any]] = comparison_record(self)["models"]
        first = next(iter(rows), dict[str, Any]())
        names = [name for name in first if name not in ("runs", "failed")]
        return {name: [row[name] for row in rows] for name in names}

    def _draw(self, path: Path) -> Path:
        return plot_comparison(path, self)


def shown_comparison(found: Comparison) -> ShownComparison:
    """The comparison as an object with tables and plots."""
    return ShownComparison(**{field.name: getattr(found, field.name) for field in fields(found)})
