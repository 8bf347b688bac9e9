"""A model from the file that a command is given: a spec, or what `msnn compile` wrote."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, cast

from backends.atomic_write import write_text
from compiler.compile import compile_spec
from compiler.linking.link import WeightsByPart, link
from compiler.program import Program
from compiler.program_file import (
    data_from_json,
    data_to_json,
    program_from_data,
    program_to_data,
)
from msnn.data.dataset import FloatArray
from msnn.spec_hash import Part, hash_of, parts_of
from msnn.submodel_weights import read_submodel_weights
from spec_schema.diagnostics import Diagnostic, Findings, SpecError
from spec_schema.errors.commands import foreign_spec
from spec_schema.errors.files import unreadable_file
from spec_schema.reader import ReadResult, read_spec
from spec_schema.settings import settings_source
from spec_schema.source import SourceText
from spec_schema.spec import Spec

PROGRAM_SUFFIX = ".program.json"


@dataclass(frozen=True, slots=True, repr=False)
class Model:
    """A program in window form with the spec that says how to train, validate and export it.

    `sources` are the texts that diagnostics may point into; `warnings` is what reading and
    compiling had to say.
    """

    program: Program
    spec: Spec
    path: Path
    """The file of the spec; paths in it are relative to its folder."""
    text: str
    sources: tuple[SourceText, ...]
    warnings: tuple[Diagnostic, ...]
    read: ReadResult
    """The spec and its sub-models as their files have them; `spec` is both in one."""
    parts: tuple[Part, ...] = ()
    """Its sub-models, those of sub-models too."""
    part_weights: WeightsByPart = field(default_factory=dict[str, Mapping[str, FloatArray]])
    """The arrays that their `weights:` have; empty for a program file."""

    @property
    def name(self) -> str:
        return self.program.name

    def __repr__(self) -> str:
        return f"<Model {self.name} from {self.path}>"

    @property
    def folder(self) -> Path:
        return self.path.parent


def load_model(
    path: str | Path, settings: Sequence[str] = (), *, strict_units: bool = False
) -> Model:
    """The model in a spec (`.yaml`, `.json`) or in a program file (`….program.json`).

    `settings` such as `train.0.epochs=5` replace values of the workflow sections. Raises SpecError
    with everything that is wrong; `strict_units` makes warnings about units errors.
    """
    path = Path(path)
    if path.name.endswith(PROGRAM_SUFFIX):
        return _from_program_file(path, settings)
    return _compiled(read_spec(path, settings=settings), path, settings, strict_units)


def with_engine(model: Model, engine: Literal["auto", "native", "torch"]) -> Model:
    """The model with every stage trained by this engine."""
    stages = tuple(stage.model_copy(update={"engine": engine}) for stage in model.spec.train)
    return replace(model, spec=model.spec.model_copy(update={"train": stages}))


def write_program_file(model: Model, folder: Path) -> Path:
    """Writes `<name>.program.json`: the program, and the spec's text for the workflow sections.

    The texts of sub-models stand there too; of their weights the program has what it needs.
    """
    file = folder / f"{model.name}{PROGRAM_SUFFIX}"
    spec: dict[str, Any] = {"path": _seen_from(folder, model.path), "text": model.text}
    if model.parts:
        texts = {part.path: part.text for part in model.parts}
        spec["texts"] = {_seen_from(folder, path): text for path, text in texts.items()}
        spec["weights"] = {part.name: part.weights for part in model.parts if part.weights}
    return write_text(file, data_to_json(program_to_data(model.program) | {"spec": spec}))


def _seen_from(folder: Path, path: str | Path) -> str:
    return Path(os.path.relpath(path, folder)).as_posix()


def _compiled(read: ReadResult, path: Path, settings: Sequence[str], strict_units: bool) -> Model:
    sources = (*read.sources, settings_source(settings))
    text, findings = read.source.text, Findings()
    findings.report(*read.warnings)
    weights = read_submodel_weights(read, findings)
    parts = parts_of(read, weights.digests)
    try:
        findings.raise_errors()
        compiled = compile_spec(
            read.spec,
            used=read.used,
            weights=weights.arrays,
            strict_units=strict_units,
            spec_hash=hash_of(text, parts),
        )
    except SpecError as error:
        findings.report(*error.diagnostics)
        raise SpecError(findings.in_order, sources) from None
    warnings = (*findings.in_order, *compiled.warnings)
    return Model(
        compiled.program, compiled.spec, path, text, sources, warnings, read, parts, weights.arrays
    )


def _from_program_file(file: Path, settings: Sequence[str]) -> Model:
    """The program as it stands in the file; the spec's text is read for its other sections."""
    shown = str(file)
    try:
        text = file.read_text(encoding="utf-8")
    except OSError as error:
        raise SpecError([unreadable_file(shown, (error.strerror or str(error)).lower())]) from error
    except UnicodeDecodeError as error:
        raise SpecError([unreadable_file(shown, "it is not UTF-8 text")]) from error
    data = data_from_json(text, shown)
    embedded = _embedded_spec(data, file.parent)
    program = program_from_data(data, shown)
    if embedded is None:
        raise SpecError([foreign_spec(shown)])
    read = read_spec(embedded.path, embedded.text, settings, texts=embedded.texts)
    parts, text = parts_of(read, embedded.weights), read.source.text
    if program.spec_hash != hash_of(text, parts) or program.name != read.spec.name.value:
        raise SpecError([foreign_spec(shown)])
    sources = (*read.sources, settings_source(settings))
    spec = link(
        read.spec, read.used, {}, Findings()
    ).spec  # which compiled when the file was written
    return Model(program, spec, embedded.path, text, sources, read.warnings, read, parts)


@dataclass(frozen=True, slots=True)
class _EmbeddedSpec:
    """The spec in a program file, the texts of sub-models by path, digests of their weights."""

    path: Path
    text: str
    texts: Mapping[str, str]
    weights: Mapping[str, str]


def _embedded_spec(data: Any, folder: Path) -> _EmbeddedSpec | None:
    """Takes the spec out of the data of a program file; None if it is not there."""
    found = cast("dict[str, Any]", data).pop("spec", None) if isinstance(data, dict) else None
    match found:
        case {"path": str(path), "text": str(text)} if "\0" not in path:
            spec = Path(os.path.normpath(folder / path))
        case _:
            return None
    texts, weights = _texts(found.get("texts")), _texts(found.get("weights"))
    texts = {os.path.normpath(folder / path): text for path, text in texts.items()}
    return _EmbeddedSpec(spec, text, texts, weights)


def _texts(data: Any) -> dict[str, str]:
    """The texts in a JSON object, which may hold anything."""
    items = cast("dict[str, Any]", data).items() if isinstance(data, dict) else ()
    return {name: text for name, text in items if isinstance(text, str) and "\0" not in name}
