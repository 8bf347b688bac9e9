"""A model from the file that a command is given: a spec, or what `msnn compile` wrote."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

from compiler.compile import compile_spec
from compiler.linking.link import WeightsByPart
from compiler.program import Program
from msnn.data.dataset import FloatArray
from msnn.spec_hash import Part, hash_of, parts_of
from msnn.submodel_weights import read_submodel_weights
from spec_schema.diagnostics import Diagnostic, Findings, SpecError
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
    settings: tuple[str, ...] = ()
    """Values of its workflow that were replaced: `train.0.epochs=5`."""

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
        from msnn.compiled_file import read_program_file

        model = read_program_file(path, settings)
    else:
        model = _compiled(read_spec(path, settings=settings), path, settings, strict_units)
    return replace(model, settings=tuple(settings))


def with_engine(model: Model, engine: Literal["auto", "native", "torch"]) -> Model:
    """The model with every stage trained by this engine."""
    stages = tuple(stage.model_copy(update={"engine": engine}) for stage in model.spec.train)
    spec = model.spec.model_copy(update={"train": stages})
    same = (f"train.{number}.engine={engine}" for number in range(len(stages)))
    return replace(model, spec=spec, settings=(*model.settings, *same))


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
