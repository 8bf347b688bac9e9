"""Compares trainings: of several specs, or of one with many values, by seeds and folds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from spec_schema.reading.python_values import Settings, setting_texts

if TYPE_CHECKING:
    from msnn.api.results.comparisons import ShownComparison
    from msnn.data.reading.frames import Frames
    from msnn.features.comparison.compare import ComparisonOptions, Listener
    from msnn.features.comparison.draws import Draws
    from msnn.features.comparison.variants import Grid

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
    """Trains specs, or one with every choice of a grid, and ranks them on rows held out.

        found = msnn.compare("plant.msnn.yaml", grid={"layers.h.fir.window": [5, 10, 20]}, seeds=3)
        print(found.best.variant.settings, found.best.score)
        found.to_frame()  # found.plot(); a notebook shows the table

    `grid` and `settings` are mappings, or texts as `--grid` and `--set` take them. `on` is the set
    that they are compared on; with `folds` each fold of `split: {by: kfold, k}` is
    held out in turn. `by` ranks them: `fit`, `x_next.fit` or `x_next.rmse:record`; None takes what
    the first entry of `validate` asks for. `jobs` trainings run at once, each in a process: a
    script then needs `if __name__ == "__main__"`. `cost` counts instructions and bytes of the C on
    a Cortex-M4F, where the tools are installed. `runs/runs.jsonl` has every training; one that is
    there is not repeated. Raises SpecError and TrainingInterruptedError.
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
    """Trains one spec with many values of it, of a grid and drawn at random, and ranks them.

        found = msnn.sweep(
            "plant.msnn.yaml",
            draw={"parameters.k.init": "log(1, 100) N/m", "parameters.d.init": "uniform(0.5, 2)"},
            draws=200,
            folds=True,
        )
        print(found.best.variant.settings, found.best.score)

    `draw` says by key what values are drawn from: `uniform(0.5, 2)`, `log(1e-3, 1e-1)`,
    `integer(1, 20)`, each with a unit behind it where the value has one, `choice(rk4, euler)`.
    Every one of `draws` (20) is trained with every choice of `grid`. `draw_seed` decides them: the
    same seed draws the same, and more `draws` leave those before as they are. `ray` is the address
    of a Ray cluster that trains in place of `jobs` processes (extra `ray`): `10.0.0.1:6379`,
    `auto`, or `local` for one on this machine; a connection that is open is used. With `optuna`, a
    file or database for its study, Optuna proposes what is drawn from how good the proposals before
    it were (extra `optuna`), `draws` in all; `by` says what is good. All else is as of `compare`,
    whose log it shares: what is there is not trained again. Raises SpecError,
    MissingExtraError and TrainingInterruptedError.
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
    """The arguments that every comparison takes, as its engine has them."""
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
    from msnn.api.results.comparisons import shown_comparison
    from msnn.features.comparison.compare import compare as run
    from msnn.features.comparison.variants import grid_axes

    return shown_comparison(run([Path(spec) for spec in specs], grid_axes(grid), options, listener))


def _place(path: str | Path | None) -> Path | None:
    return None if path is None else Path(path)


def _draws(draw: Sequence[str] | Mapping[str, str], count: int | None, seed: int) -> Draws:
    from msnn.features.comparison.draws import Draws, draw_axes
    from msnn.features.comparison.errors.sweeps import nothing_drawn
    from spec_schema.diagnostics.diagnostic import SpecError

    axes = draw_axes(draw)
    # a number without laws is a `draw` that was forgotten
    if count is not None and not axes:
        raise SpecError((nothing_drawn(count),))
    # without laws the grid alone is trained
    return Draws(axes, (_USUAL_DRAWS if count is None else count) if axes else 0, seed)
