"""Compares the model's held-out fold with the fold that was held out in training its weights."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import cast

from msnn.errors.results.validation import of_another_fold
from msnn.model.model import Model
from msnn.model.saved_run import DESCRIPTION, FOLD_SETTING, read_json
from msnn.model.weights.given_weights import Weights, weights_path
from spec_schema.diagnostics.diagnostic import Diagnostic

HELD_OUT = "val"
"""The set that consists of the held-out fold."""


def fold_of_another_run(
    model: Model, weights: Weights | None, measured: Collection[str]
) -> tuple[Diagnostic, ...]:
    """A warning if the evaluated fold was part of the training data of these weights.

    The fold is known only for weights in the folder of a run.
    """
    split = None if model.spec.data is None else model.spec.data.split
    if split is None or split.by != "kfold" or HELD_OUT not in measured:
        return ()
    if not isinstance(weights, str | Path):
        return ()
    run = weights_path(weights).parent
    trained = _fold_of(run)
    if trained is None or trained == split.fold:
        return ()
    return (of_another_fold(str(run), trained, split.fold),)


def _fold_of(run: Path) -> int | None:
    settings = read_json(run / DESCRIPTION).get("settings")
    # a file that somebody else may have written
    texts = cast("list[object]", settings) if isinstance(settings, list) else []
    numbers = [str(text).removeprefix(FOLD_SETTING) for text in texts]
    given = [number for number, text in zip(numbers, texts, strict=True) if number != text]
    return int(given[-1]) if given and given[-1].isdecimal() else None
