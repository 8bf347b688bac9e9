"""Compares trainings of several specs, or of one spec with many values, by seeds and folds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from msnn.api.results import Shown
from msnn.features.comparison.compare import Comparison
from msnn.features.comparison.report import comparison_cells, comparison_record, plot_comparison
from msnn.tables import Table, count
from spec_schema.reading.setting_values import Settings, setting_texts

if TYPE_CHECKING:
    from msnn.data.reading.frames import Frames
    from msnn.features.comparison.compare import ComparisonOptions, Listener
    from msnn.features.comparison.variants import Draws, Grid


_USUAL_DRAWS = 20


def compare(
    specs: str | Path | Sequence[str | Path],
    *,
    grid: Grid = (),
    settings: Settings = (),
    data: Frames | None = None,
    data_root: str | Path | None = None,
    on: str = "val",
    seeds: int = 1,
    folds: bool = False,
    runs: str | Path | None = "runs",
    jobs: int = 1,
    by: str | None = None,
    cost: bool = True,
    listener: Listener | None = None,
) -> ShownComparison:
    """Trains specs, or one with every choice of a grid, and ranks them on held-out rows.

        found = msnn.compare("plant.msnn.yaml", grid={"layers.h.fir.window": [5, 10, 20]}, seeds=3)
        print(found.best.variant.settings, found.best.score)
        found.to_frame()  # found.plot(); a notebook shows the table

    `grid` and `settings` are mappings, or texts in the form of `--grid` and `--set`. `on` is the
    set for the comparison; with `folds`, each fold of `split: {by: kfold, k}` is held out in turn.
    `by` is the criterion: `fit`, `x_next.fit` or `x_next.rmse:record`; None means the metric of the
    first entry of `validate`.

    `jobs` is the number of parallel trainings. Each runs in a process, so a script needs the guard
    `if __name__ == "__main__"`.

    `cost` counts instructions and bytes of the C code on a Cortex-M4F, if the tools
    are installed. `runs/runs.jsonl` logs every training; a logged training is not repeated. Raises
    SpecError and TrainingInterruptedError.
    """
    options = _options(
        settings=settings,
        data=data,
        data_root=data_root,
        on=on,
        seeds=seeds,
        folds=folds,
        runs=runs,
        jobs=jobs,
        by=by,
        cost=cost,
    )
    # a path alone, which is a sequence of letters too
    return _ranked([specs] if isinstance(specs, str | Path) else specs, grid, options, listener)


def sweep(
    spec: str | Path,
    *,
    grid: Grid = (),
    draw: Sequence[str] | Mapping[str, str] = (),
    draws: int | None = None,
    draw_seed: int = 0,
    settings: Settings = (),
    data: Frames | None = None,
    data_root: str | Path | None = None,
    on: str = "val",
    seeds: int = 1,
    folds: bool = False,
    runs: str | Path | None = "runs",
    jobs: int = 1,
    ray: str | None = None,
    optuna: str | Path | None = None,
    by: str | None = None,
    cost: bool = False,
    listener: Listener | None = None,
) -> ShownComparison:
    """Trains one spec with many values, from a grid and drawn at random, and ranks them.

        found = msnn.sweep(
            "plant.msnn.yaml",
            draw={"parameters.k.init": "log(1, 100) N/m", "parameters.d.init": "uniform(0.5, 2)"},
            draws=200,
            folds=True,
        )
        print(found.best.variant.settings, found.best.score)

    `draw` maps keys to distributions: `uniform(0.5, 2)`, `log(1e-3, 1e-1)`, `integer(1, 20)`, each
    followed by a unit if the value has one, or `choice(rk4, euler)`. Each of `draws` (20) samples
    is trained with every choice of `grid`. `draw_seed` makes the samples reproducible; more `draws`
    extend them without changing earlier ones.

    `ray` is the address of a Ray cluster for the trainings instead of `jobs` processes (extra
    `ray`): `10.0.0.1:6379`, `auto`, or `local` for one on this machine; an open connection is used.
    With `optuna`, a file or database for its study, Optuna proposes all `draws` samples from the
    results of earlier ones, ranked by `by` (extra `optuna`).

    All other arguments are as in `compare`, and both use the same log: a logged training is not
    repeated. Raises SpecError, MissingExtraError and TrainingInterruptedError.
    """
    common = _options(
        settings=settings,
        data=data,
        data_root=data_root,
        on=on,
        seeds=seeds,
        folds=folds,
        runs=runs,
        jobs=jobs,
        by=by,
        cost=cost,
    )
    options = replace(
        common,
        draws=_draws(draw, draws, draw_seed),
        ray=ray,
        # text: it may be the address of a database, which no path is
        optuna=None if optuna is None else str(optuna),
    )
    return _ranked([spec], grid, options, listener)


def _options(
    *,
    settings: Settings,
    data: Frames | None,
    data_root: str | Path | None,
    on: str,
    seeds: int,
    folds: bool,
    runs: str | Path | None,
    jobs: int,
    by: str | None,
    cost: bool,
) -> ComparisonOptions:
    """The common arguments of `compare` and `sweep`, as options of a comparison."""
    from msnn.features.comparison.compare import ComparisonOptions

    return ComparisonOptions(
        settings=setting_texts(settings),
        data=data,
        data_root=_place(data_root),
        held_out=on,
        seeds=seeds,
        folds=folds,
        runs=_place(runs),
        jobs=jobs,
        criterion=by,
        counts_cost=cost,
    )


def _ranked(
    specs: Sequence[str | Path],
    grid: Grid,
    options: ComparisonOptions,
    listener: Listener | None,
) -> ShownComparison:
    from msnn.features.comparison.compare import compare as run
    from msnn.features.comparison.variants import grid_axes

    return shown_comparison(run([Path(spec) for spec in specs], grid_axes(grid), options, listener))


def _place(path: str | Path | None) -> Path | None:
    return None if path is None else Path(path)


def _draws(draw: Sequence[str] | Mapping[str, str], count: int | None, seed: int) -> Draws:
    from msnn.features.comparison.errors import nothing_drawn
    from msnn.features.comparison.variants import Draws, draw_axes
    from spec_schema.diagnostics.diagnostic import SpecError

    axes = draw_axes(draw)
    # a number without laws is a `draw` that was forgotten
    if count is not None and not axes:
        raise SpecError((nothing_drawn(count),))
    # without laws the grid alone is trained
    return Draws(axes, (_USUAL_DRAWS if count is None else count) if axes else 0, seed)


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
