"""The target `fmu`: the generated C as units for co-simulation, of FMI 2.0 and 3.0."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from backends.c_lowering.options import COptions
from compiler.ir.program import Program
from compiler.ir.types import Type
from compiler.passes.retime import retime
from compiler.passes.settle_zeros import settle_zeros
from msnn.agreement.judgement import Loaded
from msnn.errors.failures import UnfitCompilerError
from msnn.exports.prepare import MOST_ENTRIES, c_options, name_prefix, step_program
from msnn.exports.target import ExportPlan, Request, Target, Weights, Written, bits_in_single
from msnn.packages import ZIGLANG
from spec_schema.sections.exports import FmuExport


def _prepare(request: Request, entry: FmuExport | None) -> ExportPlan[COptions] | None:
    delay = () if entry is None else entry.delay
    # arrays stay whole: a tool may set any of their numbers
    step = step_program(request, entry, delay, keeps_arrays=True)
    if step is None:
        return None
    # tools set parameters between steps: nothing may be computed from their values ahead
    step = settle_zeros(retime(step, fixed_parameters=False))
    return ExportPlan(
        target=TARGET,
        program=step,
        prefix=name_prefix(request, None if entry is None else entry.prefix),
        dtype=TARGET.dtype if entry is None or entry.dtype is None else entry.dtype,
        options=COptions(params="tunable", extras=("feedthrough",) if _has_slopes(step) else ()),
        platforms=() if entry is None else tuple(entry.platforms),
    )


def _has_slopes(program: Program) -> bool:
    """True if the matrix of derivatives of outputs in inputs is not too large to export."""
    outputs = sum(program.step[output.node].type.size for output in program.outputs)
    inputs = sum(Type(signal.axes).size for signal in program.signals)
    return outputs * inputs <= MOST_ENTRIES


def _write(plan: ExportPlan[COptions], weights: Weights, folder: Path) -> tuple[Path, ...]:
    from backends.c.host.build import CompilerFailedError
    from backends.fmu.write_fmu import write_fmu

    platforms = plan.platforms
    if platforms:
        ZIGLANG.require(f"compiles units for {', '.join(platforms)}")
    try:
        return write_fmu(plan.program, weights, folder, c_options(plan), platforms)
    except CompilerFailedError as error:
        raise UnfitCompilerError(error.compiler, error.said, error.remedy) from None


def _tell(plan: ExportPlan[COptions], folder: Path) -> str:
    """A sentence if the FMUs have no binary for this machine; else empty."""
    from backends.fmu.write_fmu import holds_binary

    paths = [folder / f"{plan.prefix}_fmi{version}.fmu" for version in (2, 3)]
    if all(holds_binary(path) for path in paths):
        return ""
    return "no C compiler found: the units have their sources and no binary"


@contextmanager
def _load(plan: ExportPlan[COptions], written: Written) -> Generator[Loaded]:
    from backends.c.interface.interface import c_interface
    from msnn.exports.running.loaded_fmu import loaded_fmu

    with loaded_fmu(plan.program, c_interface(plan.program, c_options(plan)), written) as loaded:
        yield loaded


TARGET: Target[FmuExport, COptions] = Target(
    name="fmu",
    entry=FmuExport,
    dtype="float32",
    options=COptions(params="tunable"),
    promise=bits_in_single,
    is_deployed=True,
    prepare=_prepare,
    write=_write,
    tell=_tell,
    load=_load,
)
