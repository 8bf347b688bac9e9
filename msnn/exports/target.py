"""Defines what an export target is to the product: a record, made in a file of its own."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import field
from pathlib import Path
from typing import Any, Generic, TypeAlias, TypeVar

from compiler.ir.program import Program
from compiler.passes.analyses.kept_slices import Cut, cut_weights
from msnn.agreement.agreement import Agreement
from msnn.agreement.judging.judgement import FloatType, Judgement, NumberType, Promise
from msnn.agreement.judging.record import AgreementRecord
from msnn.agreement.loaded import Loaded
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
    """The request for an export."""

    model: Model
    findings: Findings
    """Takes what is wrong with the target's entry."""
    extras: Collection[str] = ()
    """What the command line asks for, of any target, beside the step."""
    weights: Weights | None = None
    """Those to be written, where they are known: slices of them that are 0 are left out."""
    cuts: list[Cut] = field(default_factory=list["Cut"])
    """Takes what is kept of arrays with such slices."""


@dataclass(frozen=True, slots=True)
class Written:
    """The files that an export wrote into a folder, which may hold others."""

    folder: Path
    files: Sequence[Path]


def interpreted(
    plan: AnyPlan, weights: Weights, record: AgreementRecord, dtype: NumberType
) -> Judgement:
    """The values of the interpreter, the judge of targets that compute in floating point."""
    from msnn.agreement.judging.judge import judge

    return judge(plan.program, weights, record, dtype, restarts=plan.target.is_deployed)


def no_faults(plan: AnyPlan) -> tuple[Diagnostic, ...]:
    """The faults of targets whose plan says all: none."""
    del plan
    return ()


def nothing_to_tell(plan: AnyPlan, folder: Path) -> str:
    """The remark of targets whose files speak for themselves: none."""
    del plan, folder
    return ""


def within_rounding(dtype: NumberType) -> Promise:
    """The promise of targets whose libraries round as they like."""
    del dtype
    return Promise.ROUNDING


def bits_in_single(dtype: NumberType) -> Promise:
    """The promise of targets whose C computes in single precision as the interpreter does."""
    return Promise.BITS if dtype == "float32" else Promise.ROUNDING


@dataclass(frozen=True, kw_only=True)
class Target(Generic[OwnEntry, Options]):
    """One target. Libraries that take long to load are imported inside its functions."""

    name: str
    entry: type[OwnEntry]
    """What the spec's `export:` says of it."""
    dtype: NumberType
    """What it computes in unless the spec says otherwise."""
    options: Options
    """Its choices where the spec makes none."""
    promise: Callable[[NumberType], Promise] = within_rounding
    """What an export that computes in this keeps of what the judge does."""
    is_deployed: bool = False
    """Whether it is code of a device, which acts on `on_range: reset`."""
    is_verified: bool = False
    """Whether `msnn verify` checks what it writes."""
    prepare: Callable[[Request, OwnEntry | None], ExportPlan[Options] | None]
    """Closes loops, prunes, and takes the options; None where what is wrong is reported."""
    write: Callable[[ExportPlan[Options], Weights, Path], tuple[Path, ...]]
    """Writes its files into an empty folder. SpecError for what the target cannot hold."""
    load: Callable[[ExportPlan[Options], Written], AbstractContextManager[Loaded]] | None = None
    """Loads them. MissingExtraError where they need a tool that is not installed; None: nothing
    here runs them, and `--check` says so."""
    judge: Callable[[ExportPlan[Options], Weights, AgreementRecord, NumberType], Judgement] = (
        interpreted
    )
    """What it ought to do along a record: in float64, and in what it computes in."""
    faults: Callable[[ExportPlan[Options]], tuple[Diagnostic, ...]] = no_faults
    """What `msnn check` finds by trying."""
    without_section: Callable[[], Diagnostic] | None = None
    """The mistake of whoever names it for a spec without the sections that it needs."""
    compare: Callable[[ExportPlan[Options], Weights, Written], Agreement] | None = None
    """How what was written is compared with the judge; None: along a record, by `load`."""
    tell: Callable[[ExportPlan[Options], Path], str] = nothing_to_tell
    """What the writer wants to be said of the files in a folder."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportPlan(Generic[Options]):
    """The plan of a target's files: the program in step form, the beginning of its names."""

    target: Target[Any, Options]
    program: Program
    prefix: str
    dtype: NumberType
    options: Options
    cuts: tuple[Cut, ...] = ()
    """What the program keeps of arrays with slices of 0."""
    platforms: tuple[str, ...] = ()
    """Kinds of machines that get a binary beside this one's; nothing that runs here needs it."""

    def of(self, weights: Weights) -> Weights:
        """The weights as the program has them."""
        return cut_weights(self.cuts, weights)

    @property
    def float_type(self) -> FloatType:
        """The floating-point type of a target without fixed point."""
        assert self.dtype == "float32" or self.dtype == "float64"
        return self.dtype


AnyTarget: TypeAlias = Target[Any, Any]
"""A target of the table: its functions take its own entry and options only."""
AnyPlan: TypeAlias = ExportPlan[Any]
