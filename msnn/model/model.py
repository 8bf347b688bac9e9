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
    problems: Mapping[str, SectionProblem] = field(default_factory=dict[str, SectionProblem])
    """The compiled sections of features, such as `mpc`, with the parameters of the spec, by key."""
    types: Mapping[str, Type] = field(default_factory=dict[str, Type])
    """Of one sample of every equation and output of a spec; empty for a program file."""
    remarks: tuple[Diagnostic, ...] = ()
    """What compiling found worth a thought: `msnn check` says it, no other command does."""
    parts: tuple[SubmodelFile, ...] = ()
    """Its sub-models, those of sub-models too."""
    part_weights: WeightsByPart = field(default_factory=dict[str, Mapping[str, FloatArray]])
    """The arrays that their `weights:` have; empty for a program file."""
    settings: tuple[str, ...] = ()
    """Values that were replaced: `train.0.epochs=5`."""
    run: Path | None = None
    """The run that has kept it."""
    trained_in: str | None = None
    """The folder of its spec when that run began, where it is not here."""

    @property
    def name(self) -> str:
        return self.program.name

    def of(self, kind: type[P]) -> P | None:
        """The problem of this class; None if no section of the spec has one."""
        return problem_of_class(self.problems, kind)

    def __repr__(self) -> str:
        return f"<Model {self.name} from {self.path}>"

    @property
    def folder(self) -> Path:
        return self.path.parent
