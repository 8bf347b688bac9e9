"""Joins a program to the spec that says what to do with it, and counts its trained parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TypeVar

from compiler.elaboration.section import SectionProblem, problem_of_class
from compiler.ir.program import Program, UsedPlugin
from compiler.ir.types import Type
from compiler.linking.link import WeightsByPart
from msnn.data.dataset import FloatArray
from msnn.model.model_files import SubmodelFile
from spec_schema.diagnostics.diagnostic import Diagnostic
from spec_schema.diagnostics.source import SourceText
from spec_schema.late_dataclass import dataclass
from spec_schema.reading.reader import ReadResult
from spec_schema.sections.spec import Spec
from spec_schema.sections.training import Stage

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
    recorded: Mapping[str, UsedPlugin | None] = field(default_factory=dict[str, UsedPlugin | None])
    """By suffix of the data files of the run: the plug-in that read them, None for our formats."""
    trained_in: str | None = None
    """The folder of the spec when the run began, if it does not exist here."""

    @property
    def name(self) -> str:
        return self.program.name

    def of(self, kind: type[P]) -> P | None:
        """The compiled section of the spec, such as `mpc`, by the class of its problem; None if the
        spec has none.
        """
        return problem_of_class(self.problems, kind)

    def __repr__(self) -> str:
        return f"<Model {self.name} from {self.path}>"

    @property
    def folder(self) -> Path:
        return self.path.parent


def is_frozen(name: str, stage: Stage) -> bool:
    """True if a stage keeps the parameter at the value with which the stage begins."""
    return any(fnmatchcase(name, pattern.value) for pattern in stage.freeze)


def learned_numbers(program: Program, stages: Sequence[Stage]) -> int:
    """The number of elements that training changes; a parameter frozen in all stages is a constant.

    Without stages, every parameter with `learn` counts, because another tool may train it.
    """
    return sum(
        Type(parameter.axes).size
        for parameter in program.parameters
        if parameter.learn and (not stages or any(_moves(parameter.name, s) for s in stages))
    )


def _moves(name: str, stage: Stage) -> bool:
    # the last matching factor counts; a parameter with learning rate 0 stays as it is
    factors = [each.value for pattern, each in stage.lr.items() if fnmatchcase(name, pattern)]
    return not is_frozen(name, stage) and (not factors or factors[-1] != 0.0)
