"""Compares two models; for two runs also their accuracy."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from msnn.features.changes.model_changes import ModelChanges, Trained, model_changes
from msnn.model.model import Model
from spec_schema.diagnostics.diagnostic import Diagnostic, SpecError

if TYPE_CHECKING:
    from msnn.simulation.engines.engine import RolloutProgress


def changes(
    old: Model,
    new: Model,
    *,
    data_root: str | Path | None = None,
    must_measure: bool = False,
    progress: RolloutProgress | None = None,
) -> ModelChanges:
    """Compares two models, or two runs.

    For two runs, each is evaluated by the `validate` entries of its own spec on its data, below
    `data_root`. Unreadable data cause a warning, or SpecError with `must_measure`.
    """
    # a spec alone has no weights that could be measured, and one side alone compares with nothing
    if old.run is None or new.run is None:
        return model_changes(old, new)
    warnings: list[Diagnostic] = []
    before, after = (
        _trained(which, model, data_root, must_measure, progress, warnings)
        for which, model in (("old", old), ("new", new))
    )
    return model_changes(old, new, (before, after), tuple(warnings))


def _trained(
    which: str,
    model: Model,
    data_root: str | Path | None,
    must_measure: bool,
    progress: RolloutProgress | None,
    warnings: list[Diagnostic],
) -> Trained:
    # opened for runs alone: most comparisons are of texts
    from msnn.api.measurements import validate
    from msnn.features.changes.errors import not_measured
    from msnn.model.model_weights import choose_weights
    from msnn.model.saved_run import WEIGHTS

    assert model.run is not None
    # not through `latest`: of two runs of one model each has its own
    chosen = choose_weights(model, model.run / WEIGHTS, model.run.parent)
    try:
        found = validate(model, chosen.given, data_root=data_root, progress=progress)
    except SpecError as error:
        # the caller fails on metrics: without any, nothing would have been judged
        if must_measure:
            raise
        warnings.append(not_measured(which, error.diagnostics[0].message))
        return Trained(weights=chosen.weights, validation=None)
    return Trained(weights=chosen.weights, validation=found)
