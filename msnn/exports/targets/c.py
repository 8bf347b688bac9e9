"""The target `c`: C99 in floating point; an entry that asks for fixed point goes to that target."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import get_args

from backends.c_lowering.options import COptions
from compiler.ir.program import Program
from compiler.ir.types import Type
from compiler.passes.retime import retime
from compiler.passes.settle_zeros import settle_zeros
from msnn.agreement.judgement import Loaded
from msnn.errors import workflow
from msnn.exports.prepare import MOST_ENTRIES, c_options, name_prefix, step_program
from msnn.exports.target import (
    AnyPlan,
    AnyTarget,
    ExportPlan,
    Request,
    Target,
    Weights,
    Written,
    bits_in_single,
)
from spec_schema.registry import ARITHMETICS
from spec_schema.sections.exports import CExport, Slopes


def _prepare(request: Request, entry: CExport | None) -> AnyPlan | None:
    if entry is not None and entry.constant_time and entry.math == "libm":
        request.findings.report(workflow.untimed_library(entry.place.key))
    if entry is not None and entry.dtype in ARITHMETICS:
        integers: AnyTarget = ARITHMETICS[entry.dtype].target.value
        # its plan names its own target, so that all that follows is that of integers
        return integers.prepare(request, entry)
    options = _options(request, entry)
    delay = () if entry is None else entry.delay
    step = step_program(request, entry, delay, keeps_arrays=options.moves_parameters)
    if step is None:
        return None
    if options.extras:
        # its vector x holds samples of signals, not what retiming makes of them
        step = settle_zeros(step)
        _refuse_vast(step, request, entry)
    else:
        step = settle_zeros(retime(step, fixed_parameters=not options.moves_parameters))
    return ExportPlan(
        target=TARGET,
        program=step,
        prefix=name_prefix(request, None if entry is None else entry.prefix),
        dtype=options.dtype,
        options=options,
    )


def _options(request: Request, entry: CExport | None) -> COptions:
    named = {*request.extras, *(() if entry is None else entry.extras)}
    extras = tuple(extra for extra in get_args(Slopes) if extra in named)
    if entry is None:
        return COptions(extras=extras, ros2="ros2" in named)
    return COptions(
        dtype="float64" if entry.dtype == "float64" else "float32",
        params=entry.params,
        math=entry.math,
        ring=entry.ring,
        unroll=entry.unroll,
        constant_time=entry.constant_time,
        extras=extras,
        ros2="ros2" in named,
    )


def _refuse_vast(step: Program, request: Request, entry: CExport | None) -> None:
    remembered = sum(Type(state.axes).size for state in step.states)
    # ∂x'/∂x is the largest of the matrices
    numbers = remembered * max(remembered, 1)
    if numbers > MOST_ENTRIES:
        place = None if entry is None else entry.place.key
        request.findings.report(workflow.vast_jacobian(numbers, MOST_ENTRIES, place))


def _write(plan: ExportPlan[COptions], weights: Weights, folder: Path) -> tuple[Path, ...]:
    from backends.c import write_c

    return write_c(plan.program, weights, folder, c_options(plan))


@contextmanager
def _load(plan: ExportPlan[COptions], written: Written) -> Generator[Loaded]:
    from backends.c.interface.interface import c_interface
    from msnn.exports.running.built_c import built_c, loaded_c

    with built_c(written) as step:
        yield loaded_c(step, c_interface(plan.program, c_options(plan)))


TARGET: Target[CExport, COptions] = Target(
    name="c",
    entry=CExport,
    dtype="float32",
    options=COptions(),
    promise=bits_in_single,
    is_deployed=True,
    is_verified=True,
    prepare=_prepare,
    write=_write,
    load=_load,
)
