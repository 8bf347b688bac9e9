"""Compares a model with the one that weights were trained for, as far as their run is kept."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, cast

from msnn.errors.weights import weights_of_another_model
from msnn.model.model import Model
from spec_schema.diagnostics.diagnostic import SpecError
from spec_schema.editors.spec_data import spec_data
from spec_schema.reading.one_file import ReadResult, read_one_spec
from spec_schema.reading.settings import WORKFLOW, model_settings

SPEC_OF_RUN = "spec.msnn.yaml"
DESCRIPTION_OF_RUN = "run.json"


def refuse_other_model(model: Model, weights: Path) -> None:
    """Raises SpecError where the run of a weights file had another model, with what differs.

    The model is all of a spec but data, train, validate and export; what is said in `doc` counts
    for nothing. A file without a run beside it can be of any model that its arrays fit.
    """
    trained = _trained(weights.parent)
    if trained is None:
        return
    then, now = dict(_values(trained)), dict(_values(model.read))
    differing = [
        (path, then.get(path), now.get(path))
        for path in {**now, **then}
        if then.get(path) != now.get(path)
    ]
    if differing:
        raise SpecError([weights_of_another_model(str(weights), differing)])


def _trained(folder: Path) -> ReadResult | None:
    """The spec that a run keeps, with the values that were replaced in it."""
    try:
        text = (folder / SPEC_OF_RUN).read_text(encoding="utf-8")
        found: Any = json.loads((folder / DESCRIPTION_OF_RUN).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    given = cast("Mapping[str, Any]", found).get("settings", ()) if isinstance(found, dict) else ()
    settings = [text for text in given if isinstance(text, str)]
    try:
        return read_one_spec(folder / SPEC_OF_RUN, text, model_settings(settings))
    except SpecError:
        return None  # of a version of the language that is not read any more


def _values(read: ReadResult) -> Iterator[tuple[str, str]]:
    """Every value of the model by its path, `layers.h.fir.window`."""
    data = spec_data(read.spec)
    yield from _flat("", {key: value for key, value in data.items() if key not in WORKFLOW})


def _flat(prefix: str, value: Any) -> Iterator[tuple[str, str]]:
    if isinstance(value, dict) and value:
        for key, item in cast("dict[str, Any]", value).items():
            if key != "doc":
                yield from _flat(f"{prefix}.{key}" if prefix else key, item)
    else:
        yield prefix, json.dumps(value, ensure_ascii=False).strip('"')
