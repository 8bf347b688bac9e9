"""A model from the file that a command is given: a spec, or what `msnn compile` wrote."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, cast

from backends.atomic_write import write_text
from compiler.compile import compile_spec
from compiler.program import Program
from compiler.program_file import (
    data_from_json,
    data_to_json,
    program_from_data,
    program_to_data,
)
from spec_schema.diagnostics import Diagnostic, SpecError
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
    """Writes `<name>.program.json`: the program, and the spec's text for the workflow sections."""
    file = folder / f"{model.name}{PROGRAM_SUFFIX}"
    spec_path = Path(os.path.relpath(model.path, folder)).as_posix()
    data = program_to_data(model.program) | {"spec": {"path": spec_path, "text": model.text}}
    return write_text(file, data_to_json(data))


def _compiled(read: ReadResult, path: Path, settings: Sequence[str], strict_units: bool) -> Model:
    sources = (read.source, settings_source(settings))
    text = read.source.text
    try:
        compiled = compile_spec(read.spec, strict_units=strict_units, spec_hash=_hash(text))
    except SpecError as error:
        raise SpecError((*read.warnings, *error.diagnostics), sources) from None
    warnings = (*read.warnings, *compiled.warnings)
    return Model(compiled.program, read.spec, path, text, sources, warnings)


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
    embedded = _embedded_spec(data)
    program = program_from_data(data, shown)
    if embedded is None:
        raise SpecError([foreign_spec(shown)])
    spec_path, spec_text = embedded
    path = Path(os.path.normpath(file.parent / spec_path))
    read = read_spec(path, spec_text, settings)
    if program.spec_hash != _hash(read.source.text) or program.name != read.spec.name.value:
        raise SpecError([foreign_spec(shown)])
    sources = (read.source, settings_source(settings))
    return Model(program, read.spec, path, read.source.text, sources, read.warnings)


def _embedded_spec(data: Any) -> tuple[str, str] | None:
    """Takes path and text of the spec out of the data of a program file; None if not there."""
    found = cast("dict[str, Any]", data).pop("spec", None) if isinstance(data, dict) else None
    match found:
        case {"path": str(path), "text": str(text)} if "\0" not in path:
            return path, text
        case _:
            return None


def _hash(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()
