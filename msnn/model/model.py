"""Joins a program to the spec that says what to do with it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field
from pathlib import Path
from typing import TypeVar

from compiler.elaboration.section import SectionProblem, problem_of_class
from compiler.ir.program import Program
from compiler.ir.types import Type
from compiler.linking.link import WeightsByPart
from msnn.data.dataset import FloatArray
from msnn.model.spec_hash import SubmodelFile
from spec_schema.diagnostics.diagnostic import Diagnostic
from spec_schema.diagnostics.source import SourceText
from spec_schema.late_dataclass import dataclass
from spec_schema.reading.reader import ReadResult
from spec_schema.sections.spec import Spec

P = TypeVar("P", bound=SectionProblem)

PROGRAM_SUFFIX = ".program.json"
"""How the names of program files end, which `msnn compile` writes."""


@dataclass(frozen=True, slots=True, repr=False, kw_only=True)
class Model:
    """A program in window form and the spec that defines its training, validation and export.

    `sources` are the texts that diagnostics point into; `warnings` come from reading and compiling.
    """

    program: Program
    spec: Spec
    path: Path
    """The file of the spec; paths in it are relative to its folder."""
    text: str
    sources: tuple[SourceText, ...]
    warnings: tuple[Diagnostic, ...]
    read: ReadResult
    """The spec and its sub-models as separate files; `spec` is the merged form."""
    problems: Mapping[str, SectionProblem] = field(default_factory=dict[str, SectionProblem])
    """The compiled sections of features, such as `mpc`, with the parameters of the spec, by key."""
    types: Mapping[str, Type] = field(default_factory=dict[str, Type])
    """The type of one sample of every equation and output; empty for a program file."""
    remarks: tuple[Diagnostic, ...] = ()
    """Remarks of the compiler that only `msnn check` prints."""
    parts: tuple[SubmodelFile, ...] = ()
    """The files of all sub-models, including nested ones."""
    part_weights: WeightsByPart = field(default_factory=dict[str, Mapping[str, FloatArray]])
    """The arrays from the `weights:` of sub-models; empty for a program file."""
    settings: tuple[str, ...] = ()
    """Overridden values, such as `train.0.epochs=5`."""
    run: Path | None = None
    """The run from whose folder the model was loaded; None for a spec or a program file."""
    trained_in: str | None = None
    """The folder of the spec when the run began, if it does not exist here."""

    @property
    def name(self) -> str:
        return self.program.name

    def of(self, kind: type[P]) -> P | None:
        """The compiled section of this class; None if the spec has no such section."""
        return problem_of_class(self.problems, kind)

    def __repr__(self) -> str:
        return f"<Model {self.name} from {self.path}>"

    @property
    def folder(self) -> Path:
        return self.path.parent
