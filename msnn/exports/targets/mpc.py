"""The target `mpc`: the controller of the spec's `mpc` section as self-contained C99."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

from compiler.optimal_control.problem import ControlProblem
from msnn.agreement.agreement import Agreement
from msnn.errors import predictive_control
from msnn.errors.failures import MissingExtraError
from msnn.exports.prepare import name_prefix
from msnn.exports.target import ExportPlan, Request, Target, Weights, Written
from spec_schema.sections.exports import MpcExport


@dataclass(frozen=True, slots=True)
class Controlled:
    """The problem of a plan."""

    problem: ControlProblem | None

    @property
    def known(self) -> ControlProblem:
        """The problem of a plan that was prepared."""
        assert self.problem is not None
        return self.problem


def _prepare(request: Request, entry: MpcExport | None) -> ExportPlan[Controlled] | None:
    problem, report = request.model.control, request.findings.report
    if problem is None:
        if entry is not None:
            report(predictive_control.no_control(entry.place.key))
        return None
    place = None if request.model.spec.mpc is None else request.model.spec.mpc.place.key
    if any(block > 1 for block in problem.blocks):
        report(predictive_control.unsupported_blocks(place))
        return None
    if entry is not None and (entry.outputs is not None or entry.close):
        key = "outputs" if entry.outputs is not None else "close"
        report(predictive_control.unsuited_key(key, entry.place.key))
        return None
    return ExportPlan(
        target=TARGET,
        program=problem.program,
        prefix=name_prefix(request, None if entry is None else entry.prefix),
        dtype=TARGET.dtype if entry is None or entry.dtype is None else entry.dtype,
        options=Controlled(problem),
    )


def _write(plan: ExportPlan[Controlled], weights: Weights, folder: Path) -> tuple[Path, ...]:
    from backends.predictive_control import write_controller

    return write_controller(
        plan.options.known, _own(plan, weights), folder, prefix=plan.prefix, dtype=plan.float_type
    )


def _own(plan: ExportPlan[Controlled], weights: Weights) -> Weights:
    known = {parameter.name for parameter in plan.program.parameters}
    return {name: values for name, values in weights.items() if name in known}


def _load(plan: ExportPlan[Controlled], written: Written) -> NoReturn:
    raise AssertionError("a controller is judged by its plans, not by its steps")


@contextmanager
def built_controller(written: Written) -> Generator[Path]:
    """The folder of the files that were written, with the built `controller.so`.

    Raises MissingExtraError without a C compiler.
    """
    from backends.c.host.build import CompilerFailedError, build_library
    from backends.files.c_compiler import CompilerMissingError

    with tempfile.TemporaryDirectory() as place:
        alone = Path(place)
        for file in written.files:
            copy = alone / file.relative_to(written.folder)
            copy.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(file, copy)
        try:
            build_library(alone, alone / "controller.so")
        except CompilerMissingError:
            raise MissingExtraError("a C compiler", "apt install gcc, or set CC") from None
        except CompilerFailedError as error:
            raise MissingExtraError("a C compiler that accepts the export", str(error)) from None
        yield alone


def _compare(plan: ExportPlan[Controlled], weights: Weights, written: Written) -> Agreement:

    from msnn.exports.judged_controller import compare_controller

    with built_controller(written) as folder:
        return compare_controller(
            plan.options.known, _own(plan, weights), folder, plan.float_type, target=TARGET.name
        )


TARGET: Target[MpcExport, Controlled] = Target(
    name="mpc",
    entry=MpcExport,
    dtype="float64",
    options=Controlled(None),
    prepare=_prepare,
    write=_write,
    load=_load,
    compare=_compare,
)
