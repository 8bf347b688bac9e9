"""Exports a model: closes loops, prunes to the wanted outputs, lets a backend write its files."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, TypeAlias, assert_never, get_args

from backends.ports.identifiers import c_identifier
from compiler.ir.program import Declared, Program, State
from compiler.ir.types import Type
from compiler.passes.close_loop import LoopError, close_loop
from compiler.passes.limit_expected import limit_expected
from compiler.passes.prune_outputs import prune_outputs
from compiler.passes.retime import retime
from compiler.passes.settle_zeros import settle_zeros
from compiler.passes.to_step_form import to_step_form
from msnn.data.dataset import FloatArray
from msnn.errors import commands, workflow
from msnn.model.model import Model
from spec_schema.diagnostics.diagnostic import Diagnostic, Findings, SpecError
from spec_schema.diagnostics.source import Span
from spec_schema.errors.fixed_point import (
    fixed_point_option,
    no_integer_slopes,
    saturates_all_the_same,
)
from spec_schema.errors.states import not_closable
from spec_schema.sections.exports import (
    CasadiExport,
    CExport,
    Export,
    Extra,
    OnnxExport,
    TorchExport,
)

TargetName: TypeAlias = Literal["torch", "onnx", "casadi", "c"]
Dtype: TypeAlias = Literal["float32", "float64"]
FixedPoint: TypeAlias = Literal["q15", "q31"]
TARGETS: tuple[TargetName, ...] = ("torch", "onnx", "casadi", "c")
EXTRAS: tuple[Extra, ...] = get_args(Extra)
MOST_ENTRIES = 250_000
"""Of a matrix of a Jacobian: a megabyte in single precision."""


@dataclass(frozen=True, slots=True)
class ExportPlan:
    """One target: the program in step form, the beginning of its names, and its number type."""

    target: TargetName
    program: Program
    prefix: str
    dtype: Dtype
    c: CExport | None = None
    """What the spec says of generated C besides."""
    fixed_point: FixedPoint | None = None
    """C in integers of this format instead of `dtype`."""
    extras: tuple[Extra, ...] = ()
    """What C has beside the step."""


def target_names(names: Sequence[str], export: Export | None) -> tuple[TargetName, ...]:
    """The targets that a command line names; by default those of the spec, else all of them.

    Raises SpecError for a name that is no target.
    """
    faults = [commands.unknown_target(n, TARGETS) for n in names if n not in (*TARGETS, "all")]
    if faults:
        raise SpecError(faults)
    if "all" in names:
        return TARGETS
    wanted: dict[TargetName, bool] = {target: target in names for target in TARGETS}
    if not names:
        wanted = {target: _entry(export, target) is not None for target in TARGETS}
    return tuple(target for target in TARGETS if wanted[target]) or TARGETS


def plan_exports(
    model: Model,
    targets: Sequence[TargetName],
    findings: Findings,
    extras: Collection[str] = (),
) -> list[ExportPlan]:
    """How each target will be written; what is wrong with its entry goes to `findings`.

    `extras` are for C, besides those of the spec.
    """
    plans = (_plan(model, target, findings, extras) for target in targets)
    return [plan for plan in plans if plan is not None]


def write_export(
    plan: ExportPlan, weights: Mapping[str, FloatArray], folder: Path
) -> tuple[Path, ...]:
    """Writes the files of one target into the folder and returns their paths.

    They appear there when all of them are written: a command that is killed leaves what was there.
    """
    from backends.files.atomic_write import replacing_files  # `check` plans exports without it

    with replacing_files(folder) as temporary:
        files = _written(plan, weights, temporary)
    return tuple(folder / path.relative_to(temporary) for path in files)


def _written(plan: ExportPlan, weights: Mapping[str, FloatArray], folder: Path) -> tuple[Path, ...]:
    """The files of one target, written by its backend.

    That is imported when its target is written: one needs no other one's library.
    """
    match plan.target:
        case "torch":
            from backends.torch_module.files import write_torch

            return write_torch(plan.program, weights, folder, plan.prefix, plan.dtype)
        case "onnx":
            from backends.onnx_model.files import write_onnx

            return write_onnx(plan.program, weights, folder, plan.prefix, plan.dtype)
        case "casadi":
            from backends.casadi_function.files import write_casadi

            return write_casadi(plan.program, weights, folder, plan.prefix)
        case "c" if plan.fixed_point is not None:
            from backends.fixed_point import write_fixed_c

            return write_fixed_c(plan.program, weights, folder, plan.prefix, plan.fixed_point).files
        case "c":
            from backends.c import COptions, write_c

            options = COptions(dtype=plan.dtype, prefix=plan.prefix, extras=plan.extras)
            if plan.c is not None:
                options = replace(
                    options,
                    params=plan.c.params,
                    math=plan.c.math,
                    ring=plan.c.ring,
                    unroll=plan.c.unroll,
                    constant_time=plan.c.constant_time,
                )
            return write_c(plan.program, weights, folder, options)
        case _:
            assert_never(plan.target)


_TargetEntry: TypeAlias = TorchExport | OnnxExport | CasadiExport | CExport


def _entry(export: Export | None, target: TargetName) -> _TargetEntry | None:
    if export is None:
        return None
    match target:
        case "torch":
            return export.torch
        case "onnx":
            return export.onnx
        case "casadi":
            return export.casadi
        case "c":
            return export.c
        case _:
            assert_never(target)


def _plan(
    model: Model, target: TargetName, findings: Findings, extras: Collection[str]
) -> ExportPlan | None:
    entry = _entry(model.spec.export, target)
    dtype: Dtype = "float32" if target == "c" else "float64"
    fixed_point: FixedPoint | None = None
    prefix = c_identifier(model.name, set())
    program: Program | None = model.program
    if entry is not None:
        match entry.dtype:
            case "q15" | "q31":
                fixed_point = entry.dtype
            case _:
                dtype = entry.dtype or dtype
        if isinstance(entry, CasadiExport | CExport) and entry.prefix is not None:
            prefix = c_identifier(entry.prefix.value, set())
        if isinstance(entry, CasadiExport) and dtype != "float64":
            findings.report(workflow.casadi_is_double(entry.place.key))
        if isinstance(entry, CExport) and entry.constant_time and entry.math == "libm":
            findings.report(workflow.untimed_library(entry.place.key))
        program = _closed(program, entry, findings)
    if program is None:
        return None
    outputs = _outputs(model, entry, findings)
    step = to_step_form(prune_outputs(program, outputs))
    c = entry if isinstance(entry, CExport) else None
    if fixed_point is not None and c is not None:
        findings.report(*(fixed_point_option(name, c.place.key) for name in _float_options(c)))
    if target != "c":
        return ExportPlan(target, step, prefix, dtype, c, fixed_point)
    named: set[str] = {*extras, *(c.extras if c is not None else ())}
    wanted = _extras(named)
    if fixed_point is not None:
        step = limit_expected(step)
        if wanted and c is not None:
            findings.report(no_integer_slopes(c.place.key))
        flagged = [s.name for s in step.states if _is_flagged(s)]
        if flagged and c is not None:
            findings.report(saturates_all_the_same(flagged, c.place.key))
    elif wanted:
        # its vector x holds samples of signals, not what retiming makes of them
        step = settle_zeros(step)
        _refuse_vast(step, c, findings)
    else:
        step = settle_zeros(retime(step, fixed_parameters=c is None or c.params != "tunable"))
    return ExportPlan(target, step, prefix, dtype, c, fixed_point, wanted)


def _is_flagged(state: State) -> bool:
    """Whether a declared state may leave its range in floating point."""
    flags = state.on_range == "flag" and state.range is not None
    return flags and isinstance(state.origin, Declared)


def _extras(named: Collection[str]) -> tuple[Extra, ...]:
    return tuple(extra for extra in EXTRAS if extra in named)


def _refuse_vast(step: Program, c: CExport | None, findings: Findings) -> None:
    remembered = sum(Type(state.axes).size for state in step.states)
    numbers = remembered * max(remembered, 1)
    if numbers > MOST_ENTRIES:
        place = c.place.key if c is not None else None
        findings.report(workflow.vast_jacobian(numbers, MOST_ENTRIES, place))


def _float_options(entry: CExport) -> list[str]:
    """The options of floating-point C that an entry sets."""
    options = {
        "params": "const",
        "math": "own",
        "ring": "auto",
        "unroll": 4,
        "constant_time": False,
    }
    return [name for name, usual in options.items() if getattr(entry, name) != usual]


def _closed(program: Program, entry: _TargetEntry, findings: Findings) -> Program | None:
    try:
        return close_loop(program, [name.value for name in entry.close])
    except LoopError as error:
        place = next((name.span for name in entry.close if name.value == error.signal), None)
        findings.report(loop_fault(error, place))
        return None


def loop_fault(error: LoopError, place: Span | None) -> Diagnostic:
    """Why a signal cannot be fed back, at the place that asks for it or else where it fails."""
    through = f" ({' → '.join(error.cycle)})" if error.cycle else ""
    return not_closable(error.signal, place or error.span, f"{error.kind.value}{through}")


def _outputs(model: Model, entry: _TargetEntry | None, findings: Findings) -> list[str]:
    """The names of what a target computes; equations only where its entry names them."""
    known = [output.name for output in model.program.outputs]
    if entry is None or entry.outputs is None:
        return [name for name in known if name in model.spec.outputs]
    unknown = [name for name in entry.outputs if name.value not in known]
    findings.report(*(workflow.unknown_output(n.value, n.span, known) for n in unknown))
    return [name.value for name in entry.outputs if name.value in known]
