"""Defines how a section that a feature brings, such as `mpc`, takes part in the compilation of a
spec.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, Generic, Protocol, TypeAlias, TypeVar, cast

from compiler.ir.program import Program
from compiler.linking.link import Linked
from spec_schema.diagnostics.diagnostic import Diagnostic
from spec_schema.diagnostics.source import Span
from spec_schema.fields.entry import Entry
from spec_schema.late_dataclass import dataclass
from spec_schema.plugins import PluginPart, is_a
from spec_schema.registry import SECTIONS, SectionLine

E = TypeVar("E", bound=Entry)


class SectionProblem(Protocol):
    """The compiled form of a section of a feature, such as the optimal control problem of `mpc`."""

    @property
    def program(self) -> Program:
        """The program that is run to solve the problem; `msnn show` lists its inputs too."""
        ...


P = TypeVar("P", bound=SectionProblem)


@dataclass(frozen=True)
class OtherProgram:
    """A program that a section needs in addition to the program of the model, and the warnings
    about it.
    """

    program: Program
    """The program, with the hash of the model's spec."""
    findings: tuple[Diagnostic, ...]
    """Warnings about it that the program of the model does not have."""


CompileOther: TypeAlias = Callable[[Linked], OtherProgram]
"""Compiles another linked spec with the options of the model. Raises SpecError with its
mistakes."""


@dataclass(frozen=True)
class CompiledSection(Generic[P]):
    """The compiled form of a section, and warnings about the section."""

    problem: P
    warnings: tuple[Diagnostic, ...] = ()


def no_names(entry: Entry) -> Iterable[str]:
    """Returns no names: the default for sections that do not refer to entries of the spec."""
    del entry
    return ()


@dataclass(frozen=True, kw_only=True)
class Section(Generic[E, P]):
    """The functions by which a feature compiles and shows its section: `E` is the class of the
    section's keys, `P` that of its compiled form.
    """

    compile: Callable[[E, Linked, Program, CompileOther], CompiledSection[P]]
    """Returns the compiled section, from the entry, the linked spec and the model's program. Raises
    SpecError with every mistake of the section."""
    text: Callable[[P], str]
    """Returns the tables that `msnn show` prints for the section."""
    names_used: Callable[[E], Iterable[str]] = no_names
    """Returns the names of the spec that the section refers to; they count as used."""


def problem_of_class(problems: Mapping[str, SectionProblem], kind: type[P]) -> P | None:
    """The compiled section that is of class `kind`, out of `problems` by key; None if there is
    none.
    """
    return next((problem for problem in problems.values() if isinstance(problem, kind)), None)


AnySection: TypeAlias = Section[Any, Any]


def section_of(line: SectionLine) -> AnySection:
    """The functions of the section that `line` of the registry lists; their module is imported
    first. For a plug-in they are wrapped, so that its mistakes raise SpecError (E0230).
    """
    section: object = line.section.value
    if line in SECTIONS.ours:
        return cast("AnySection", section)
    part = PluginPart("section", line.key, line.section.module)
    if not isinstance(section, Section):
        raise part.fault(f"is a {type(section).__name__}, not a Section")
    ours = cast("AnySection", section)

    def names_used(entry: Entry) -> Iterable[str]:
        return tuple(ours.names_used(entry))

    return Section(
        compile=part.guarded(ours.compile, _fault_of_compiled, _place),
        text=part.guarded(ours.text, is_a(str)),
        names_used=part.guarded(names_used, place=_place),
    )


def _place(entry: Entry, *arguments: object) -> Span:
    del arguments
    return entry.place.key


def _fault_of_compiled(found: object, *arguments: object) -> str | None:
    if not isinstance(found, CompiledSection):
        return is_a(CompiledSection)(found, *arguments)
    compiled = cast("CompiledSection[Any]", found)
    if not isinstance(getattr(compiled.problem, "program", None), Program):
        return f"compiled to a {type(compiled.problem).__name__} without a `program`"
    warnings = cast("tuple[object, ...]", compiled.warnings)
    if not all(isinstance(each, Diagnostic) for each in warnings):
        return "returned a warning that is no Diagnostic"
    return None
