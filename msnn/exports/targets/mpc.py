"""The target `mpc`: controller and filter of the sections `mpc` and `estimator` as C99."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

from compiler.ir.program import Program
from compiler.optimal_control.problem import ControlProblem
from compiler.state_estimation.problem import EstimationProblem
from msnn.agreement.agreement import Agreement
from msnn.errors import predictive_control
from msnn.errors.failures import MissingExtraError
from msnn.exports.prepare import name_prefix
from msnn.exports.target import ExportPlan, Request, Target, Weights, Written
from spec_schema.sections.exports import MpcExport


@dataclass(frozen=True, slots=True)
class Online:
    """The problems of a plan; one of them at least."""

    control: ControlProblem | None
    estimation: EstimationProblem | None


def _prepare(request: Request, entry: MpcExport | None) -> ExportPlan[Online] | None:
    control, estimation = request.model.control, request.model.estimation
    report = request.findings.report
    if control is not None:
        program = control.program
    elif estimation is not None:
        program = estimation.program
    else:
        if entry is not None:
            report(predictive_control.no_control(entry.place.key))
        return None
    place = None if request.model.spec.mpc is None else request.model.spec.mpc.place.key
    if control is not None and any(block > 1 for block in control.blocks):
        report(predictive_control.unsupported_blocks(place))
        return None
    if entry is not None and (entry.outputs is not None or entry.close):
        key = "outputs" if entry.outputs is not None else "close"
        report(predictive_control.unsuited_key(key, entry.place.key))
        return None
    return ExportPlan(
        target=TARGET,
        program=program,
        prefix=name_prefix(request, None if entry is None else entry.prefix),
        dtype=TARGET.dtype if entry is None or entry.dtype is None else entry.dtype,
        options=Online(control, estimation),
    )


def _write(plan: ExportPlan[Online], weights: Weights, folder: Path) -> tuple[Path, ...]:
    from backends.predictive_control import write_controller
    from backends.predictive_control.estimation import write_filter

    files: tuple[Path, ...] = ()
    prefix, dtype = plan.prefix, plan.float_type
    control, estimation = plan.options.control, plan.options.estimation
    if control is not None:
        own = _own(control.program, weights)
        files += write_controller(control, own, folder, prefix=prefix, dtype=dtype)
    if estimation is not None:
        own = _own(estimation.program, weights)
        files += write_filter(estimation, own, folder, prefix=prefix, dtype=dtype)
    return files


def _own(program: Program, weights: Weights) -> Weights:
    known = {parameter.name for parameter in program.parameters}
    return {name: values for name, values in weights.items() if name in known}


def _load(plan: ExportPlan[Online], written: Written) -> NoReturn:
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


def _compare(plan: ExportPlan[Online], weights: Weights, written: Written) -> Agreement:
    from msnn.exports.judged_controller import compare_controller
    from msnn.exports.judged_filter import compare_filter, joined

    found: list[Agreement] = []
    control, estimation = plan.options.control, plan.options.estimation
    with built_controller(written) as folder:
        if control is not None:
            own = _own(control.program, weights)
            found.append(compare_controller(control, own, folder, plan.float_type, TARGET.name))
        if estimation is not None:
            own = _own(estimation.program, weights)
            found.append(compare_filter(estimation, own, folder, plan.float_type, TARGET.name))
    return joined(found)


def _tell(plan: ExportPlan[Online], folder: Path) -> str:
    """Whether the self-tests know the bits that every build gives."""
    del plan
    tests = [path.read_text(encoding="utf-8") for path in folder.glob("src/*_selftest.c")]
    if all("golden" in text for text in tests):
        return ""
    return "nothing compiles C here: self-tests know no bits to compare a build with"


TARGET: Target[MpcExport, Online] = Target(
    name="mpc",
    entry=MpcExport,
    dtype="float64",
    options=Online(None, None),
    is_verified=True,
    prepare=_prepare,
    write=_write,
    load=_load,
    compare=_compare,
    tell=_tell,
)
