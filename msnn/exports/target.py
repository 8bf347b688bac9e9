"""Defines the interface of an export target: a record of functions in a module of its own."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import field
from pathlib import Path
from typing import Any, Generic, TypeAlias, TypeVar

from compiler.ir.program import Program
from compiler.passes.analyses.kept_slices import Cut, cut_weights
from msnn.agreement.agreement import Agreement
from msnn.agreement.judgement import (
    AgreementRecord,
    FloatType,
    Judgement,
    Loaded,
    NumberType,
    Promise,
)
from msnn.data.dataset import FloatArray
from msnn.model.model import Model
from spec_schema.diagnostics.diagnostic import Diagnostic, Findings
from spec_schema.late_dataclass import dataclass
from spec_schema.sections.exports import TargetEntry

OwnEntry = TypeVar("OwnEntry", bound=TargetEntry)
Options = TypeVar("Options")
Weights: TypeAlias = Mapping[str, FloatArray]


@dataclass(frozen=True, slots=True)
class Request:
    """The arguments for planning an export: model, options, and the findings for errors in its
    entry.
    """

    model: Model
    findings: Findings
    """Collects errors in the target's entry."""
    extras: Collection[str] = ()
    """Extras requested on the command line, for any target."""
    weights: Weights | None = None
    """The weights to be written, if known; slices that are 0 are omitted."""
    cuts: list[Cut] = field(default_factory=list["Cut"])
    """Collects the remaining slices of such arrays."""


@dataclass(frozen=True, slots=True)
class Written:
    """The files that an export wrote into a folder; the folder may contain others."""

    folder: Path
    files: Sequence[Path]


def interpreted(
    plan: AnyPlan, weights: Weights, record: AgreementRecord, dtype: NumberType
) -> Judgement:
    """The values of the interpreter, the reference of floating-point targets."""
    from msnn.agreement.judge import judge

    return judge(plan.program, weights, record, dtype, restarts=plan.target.is_deployed)


def no_faults(plan: AnyPlan) -> tuple[Diagnostic, ...]:
    """Returns no diagnostics, for targets without additional checks."""
    del plan
    return ()


def nothing_to_tell(plan: AnyPlan, folder: Path) -> str:
    """Returns an empty text, for targets without remarks about their files."""
    del plan, folder
    return ""


def within_rounding(dtype: NumberType) -> Promise:
    """The promise of targets whose libraries determine rounding: errors within rounding."""
    del dtype
    return Promise.ROUNDING


def bits_in_single(dtype: NumberType) -> Promise:
    """The promise of C targets: identical bits in single precision, else errors within rounding."""
    return Promise.BITS if dtype == "float32" else Promise.ROUNDING


@dataclass(frozen=True, kw_only=True)
class Target(Generic[OwnEntry, Options]):
    """A target of exports, as a record of functions that plan, write, load and compare its files.

    Libraries that are slow to import are imported inside these functions.
    """

    name: str
    entry: type[OwnEntry]
    """Class of its entry in the spec's `export:`."""
    dtype: NumberType
    """Default number format."""
    options: Options
    """Default options."""
    promise: Callable[[NumberType], Promise] = within_rounding
    """The promised accuracy for a number format."""
    is_deployed: bool = False
    """True for deployed code, which implements `on_range: reset`."""
    is_verified: bool = False
    """True if `msnn verify` checks its files."""
    prepare: Callable[[Request, OwnEntry | None], ExportPlan[Options] | None]
    """Closes loops, removes unused outputs and reads options; None after reporting errors."""
    write: Callable[[ExportPlan[Options], Weights, Path], tuple[Path, ...]]
    """Writes its files into an empty folder. SpecError if the target cannot represent the model."""
    load: Callable[[ExportPlan[Options], Written], AbstractContextManager[Loaded]] | None = None
    """Loads the files. MissingExtraError if a required tool is not installed. None: nothing here
    runs them, and `--check` says so."""
    judge: Callable[[ExportPlan[Options], Weights, AgreementRecord, NumberType], Judgement] = (
        interpreted
    )
    """The reference values for recorded inputs, in float64 or in the target's number format."""
    faults: Callable[[ExportPlan[Options]], tuple[Diagnostic, ...]] = no_faults
    """Diagnostics that `msnn check` finds by trying the export."""
    without_section: Callable[[], Diagnostic] | None = None
    """The diagnostic if the spec lacks the sections that the target needs."""
    compare: Callable[[ExportPlan[Options], Weights, Written], Agreement] | None = None
    """Compares the files with a reference; None to compare on recorded inputs with `load`."""
    tell: Callable[[ExportPlan[Options], Path], str] = nothing_to_tell
    """A remark for the user about the files in a folder."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportPlan(Generic[Options]):
    """A planned export: the program in step form, the options, and the prefix of public names."""

    target: Target[Any, Options]
    program: Program
    prefix: str
    dtype: NumberType
    options: Options
    cuts: tuple[Cut, ...] = ()
    """The remaining slices of arrays in which slices of 0 are omitted."""
    platforms: tuple[str, ...] = ()
    """Platforms for additional binaries, which are not needed to run the export here."""

    def of(self, weights: Weights) -> Weights:
        """The weights without the slices that the export omits."""
        return cut_weights(self.cuts, weights)

    @property
    def float_type(self) -> FloatType:
        """The floating-point type of a target without fixed point."""
        assert self.dtype == "float32" or self.dtype == "float64"
        return self.dtype


AnyTarget: TypeAlias = Target[Any, Any]
"""A target with erased types: its functions accept only its own entry and options."""
AnyPlan: TypeAlias = ExportPlan[Any]
