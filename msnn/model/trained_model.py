"""Compares a model, its parts and held-out fold with those that its weights were trained for."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import Any, cast

from msnn.errors.learning.weights import weights_of_another_model
from msnn.errors.validation import of_another_fold
from msnn.model.model import Model
from msnn.model.model_files import SubmodelFile
from msnn.model.saved_run import DESCRIPTION, FOLD_SETTING, PARTS, SPEC, read_json
from msnn.model.weights.weights_file import Weights, weights_path
from spec_schema.diagnostics.diagnostic import Diagnostic, SpecError
from spec_schema.editors.spec_data import spec_data
from spec_schema.reading.reader import ReadResult, read_one_spec, refuse_endless
from spec_schema.reading.settings import model_settings, workflow
from spec_schema.registry import PartLine
from spec_schema.sections.submodels import part_kind


def refuse_other_model(model: Model, weights: Path) -> None:
    """Raises SpecError with the differences if a weights file was trained for another model.

    The model comprises the spec without its workflow sections (`workflow`) and the contents of the
    files of other parts, such as URDF files of robots; `doc` is ignored. A file outside a run's
    folder is accepted if its arrays fit.
    """
    trained = _trained(weights.parent)
    if trained is None:
        return
    differing = _differing(trained, model.read)
    if differing:
        said = [
            f"`{path}` was {_shown(then)}, here it is {_shown(now)}"
            for path, then, now in differing
        ]
        path, then, _ = differing[0]
        # `--set` cannot remove a value that is new here
        setting = None if then is None else f"{path}={then}"
        raise SpecError([weights_of_another_model(str(weights), said, setting)])
    # last: names in the spec say more than joints in a URDF
    refuse_other_parts(model.parts, weights)


def _shown(value: str | None) -> str:
    return "not there" if value is None else value


def is_of_this_model(read: ReadResult, parts: Sequence[SubmodelFile], weights: Path) -> bool:
    """True if a weights file was trained for the model of this spec and these sub-models.

    Comments, `doc` and workflow sections are ignored. False if the weights are not in a run's
    folder.
    """
    trained = _trained(weights.parent)
    if trained is None or _differing(trained, read):
        return False
    found = read_json(weights.parent / DESCRIPTION).get("parts", {})
    if not isinstance(found, dict):
        return False
    # files of initial values are ignored: the weights replace them
    each = cast("dict[str, Any]", found).items()
    kept = {name: part for name, part in each if "numbers_sha256" not in part}
    specs = [part for part in parts if not part.is_numbers]
    if kept.keys() != {part.name for part in specs}:
        return False
    return all(_is_kept(part, kept[part.name], weights) for part in specs)


def _is_kept(part: SubmodelFile, kept: object, weights: Path) -> bool:
    """True if a sub-model equals the copy in the run of the weights."""
    if not isinstance(kept, dict):
        return False
    if cast("dict[str, Any]", kept).get("weights_sha256") != part.weights:
        return False
    file = weights.parent / PARTS / part.kept_as
    if part.line is not None:
        return part_difference(part.line, file, part.text) is None
    then = _read(file, ())
    return then is not None and not _differing(then, read_one_spec(part.path, part.text))


def _differing(then: ReadResult, now: ReadResult) -> list[tuple[str, str | None, str | None]]:
    """The values that differ between two models: path, value then, value now."""
    before, after = dict(_values(then)), dict(_values(now))
    return [
        (path, before.get(path), after.get(path))
        # a dictionary for its order: that of the spec which is read now
        for path in {**after, **before}
        if before.get(path) != after.get(path)
    ]


def _trained(folder: Path) -> ReadResult | None:
    """The spec saved in a run, with the run's settings applied; None if the folder is not a run."""
    if not (folder / DESCRIPTION).is_file():
        return None
    given = read_json(folder / DESCRIPTION).get("settings", ())
    return _read(folder / SPEC, [text for text in given if isinstance(text, str)])


def _read(file: Path, settings: Sequence[str]) -> ReadResult | None:
    try:
        refuse_endless(file)
        text = file.read_text(encoding="utf-8")
        # those of its training count for nothing, as the whole section does
        return read_one_spec(file, text, model_settings(settings))
    except (OSError, ValueError, SpecError):
        return None  # not there, or of a version of the language that is not read any more


def _values(read: ReadResult) -> Iterator[tuple[str, str]]:
    """Yields every value of the model with its path, such as `layers.h.fir.window`."""
    data = spec_data(read.spec)
    sections = workflow()
    yield from _flat("", {key: value for key, value in data.items() if key not in sections})


def _flat(prefix: str, value: Any) -> Iterator[tuple[str, str]]:
    if isinstance(value, dict) and value:
        for key, item in cast("dict[str, Any]", value).items():
            if key != "doc":
                yield from _flat(f"{prefix}.{key}" if prefix else key, item)
    else:
        # an empty mapping is a value too: `h: {}` is not the same as no `h`
        yield prefix, json.dumps(value, ensure_ascii=False).strip('"')


def refuse_other_parts(parts: Sequence[SubmodelFile], weights: Path) -> None:
    """Raises SpecError if a file of a part, such as the URDF of a robot, differs from the run's
    copy.

    `weights` is the weights file of the run. Without a copy there, nothing is compared.
    """
    for part in parts:
        kept = weights.parent / PARTS / part.kept_as
        if part.line is not None and kept.is_file():
            difference = part_difference(part.line, kept, part.text)
            if difference is not None:
                differing = [f"of the {part.line.title} `{part.name}` {difference}"]
                file = f"the {part.line.file_title} `{PARTS}/{part.kept_as}`"
                raise SpecError([weights_of_another_model(str(weights), differing, kept=file)])


def part_difference(line: PartLine, kept: Path, text: str) -> str | None:
    """The difference between a part's file and the copy in a run, as a text; None if there
    is none.
    """
    try:
        refuse_endless(kept)
        before = kept.read_text(encoding="utf-8")
    except (OSError, ValueError):
        return "nothing that could be read was kept"
    # almost always, and cheaper than reading both
    return None if before == text else part_kind(line).difference(before, text)


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
