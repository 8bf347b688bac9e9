"""Sweeps over values of one spec: grids and random draws, by seeds and folds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from spec_schema.reading.python_values import Settings, setting_texts

if TYPE_CHECKING:
    from msnn.api.results.comparisons import ShownComparison
    from msnn.comparison.compare import Listener
    from msnn.comparison.draws import Draws
    from msnn.comparison.variants import Grid
    from msnn.data.reading.frames import Frames

_USUAL_DRAWS = 20


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
    from msnn.api.results.comparisons import shown_comparison
    from msnn.comparison.compare import ComparisonOptions, compare
    from msnn.comparison.variants import grid_axes

    options = ComparisonOptions(
        settings=setting_texts(settings),
        draws=_draws(draw, draws, draw_seed),
        data=data,
        data_root=None if data_root is None else Path(data_root),
        held_out=on,
        seeds=seeds,
        folds=folds,
        runs=None if runs is None else Path(runs),
        jobs=jobs,
        ray=ray,
        optuna=None if optuna is None else str(optuna),
        criterion=by,
        counts_cost=cost,
    )
    return shown_comparison(compare([Path(spec)], grid_axes(grid), options, listener))


def _draws(draw: Sequence[str] | Mapping[str, str], count: int | None, seed: int) -> Draws:
    from msnn.comparison.draws import Draws, draw_axes
    from msnn.errors.sweeps import nothing_drawn
    from spec_schema.diagnostics.diagnostic import SpecError

    axes = draw_axes(draw)
    if count is not None and not axes:
        raise SpecError((nothing_drawn(count),))
    return Draws(axes, (_USUAL_DRAWS if count is None else count) if axes else 0, seed)
