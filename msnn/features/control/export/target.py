"""The target `mpc`: controller and filter of the sections `mpc` and `estimator` as C99."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn, get_args

from compiler.ir.program import Program
from msnn.agreement.agreement import Agreement
from msnn.errors.failures import UnfitCompilerError
from msnn.exports.prepare import name_prefix
from msnn.exports.target import ExportPlan, Request, Target, Weights, Written
from msnn.features.control.errors import export as predictive_control
from msnn.features.control.keys import MpcExport, OnlineExtra
from msnn.features.control.problem.optimal_control import ControlProblem
from msnn.features.control.problem.state_estimation import EstimationProblem
from msnn.packages import FMPY, ZIGLANG

_LEAST_SINGLE, _MOST_SINGLE = 2.0**-126, (2 - 2.0**-23) * 2.0**127
"""The normal numbers of single precision."""


@dataclass(frozen=True, slots=True)
class Online:
    """The problems of an export: a controller, an estimator or both."""

    control: ControlProblem | None
    estimation: EstimationProblem | None
    extras: tuple[OnlineExtra, ...] = ()
    """What is written beside the C."""


def _prepare(request: Request, entry: MpcExport | None) -> ExportPlan[Online] | None:
    control, estimation = request.model.of(ControlProblem), request.model.of(EstimationProblem)
    report = request.findings.report
    if control is not None:
        program = control.program
    elif estimation is not None:
        program = estimation.program
    else:
        if entry is not None:
            report(predictive_control.no_control(entry.place.key))
        return None
    if entry is not None and (entry.outputs is not None or entry.close):
        key = "outputs" if entry.outputs is not None else "close"
        report(predictive_control.unsuited_key(key, entry.place.key))
        return None
    extras = _extras(request, entry)
    if entry is not None and entry.platforms and "fmu" not in extras:
        report(predictive_control.platforms_without_units(entry.place.key))
        return None
    dtype = TARGET.dtype if entry is None or entry.dtype is None else entry.dtype
    if estimation is not None and dtype == "float32":
        for name, variance in estimation.variances:
            # below the least normal number digits are lost, down to the 0 of what is known
            if not _LEAST_SINGLE <= variance <= _MOST_SINGLE:
                at = None if entry is None else entry.place.key
                report(predictive_control.variance_of_single(name, variance, at))
                return None
    return ExportPlan(
        target=TARGET,
        program=program,
        prefix=name_prefix(request, None if entry is None else entry.prefix),
        dtype=dtype,
        options=Online(control, estimation, extras),
        platforms=() if entry is None else tuple(entry.platforms),
    )


def _extras(request: Request, entry: MpcExport | None) -> tuple[OnlineExtra, ...]:
    named = {*request.extras, *(() if entry is None else entry.extras)}
    return tuple(extra for extra in get_args(OnlineExtra) if extra in named)


def _write(plan: ExportPlan[Online], weights: Weights, folder: Path) -> tuple[Path, ...]:
    from backends.files.atomic_write import write_text
    from backends.files.export_identity import MANIFEST, manifest_text
    from msnn.features.control.backend import write_controller
    from msnn.features.control.backend.write_estimator import write_estimator

    files: tuple[Path, ...] = ()
    prefix, dtype = plan.prefix, plan.float_type
    control, estimation = plan.options.control, plan.options.estimation
    if control is not None:
        own = _own(control.program, weights)
        files += write_controller(control, own, folder, prefix=prefix, dtype=dtype)
    if estimation is not None:
        own = _own(estimation.program, weights)
        files += write_estimator(estimation, own, folder, prefix=prefix, dtype=dtype)
    if "fmu" in plan.options.extras:
        files += _write_units(plan, weights, folder, files)
    files = (*files, write_text(folder / "README.md", _readme(plan)))
    contents = {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}
    return (*files, write_text(folder / MANIFEST, manifest_text(contents)))


def _write_units(
    plan: ExportPlan[Online], weights: Weights, folder: Path, files: Sequence[Path]
) -> tuple[Path, ...]:
    """Writes FMUs of the C code `files` in the folder; returns the paths written. Raises
    MissingExtraError without zig if other platforms are requested, and UnfitCompilerError.
    """
    from backends.c.host.build import CompilerFailedError
    from backends.fmu.write_fmu import write_headers
    from msnn.features.control.fmu.controller_unit import controller_unit
    from msnn.features.control.fmu.filter_unit import filter_unit
    from msnn.features.control.fmu.online_unit import write_online_unit
    from msnn.features.control.problem.trained import trained

    def sources(prefix: str) -> dict[str, str]:
        # a unit has the sources of its own part alone, without self-tests
        own = [path for path in files if path.name.startswith(prefix)]
        code = [path for path in own if path.suffix in (".c", ".h") and "selftest" not in path.name]
        return {path.name: path.read_text(encoding="utf-8") for path in code}

    def about(prefix: str) -> dict[str, Any]:
        described: dict[str, Any] = json.loads((folder / f"{prefix}.json").read_text("utf-8"))
        return described

    def identity(prefix: str) -> str:
        return str(about(prefix)["export_sha256"])

    place, platforms = folder / "fmu", plan.platforms
    if platforms:
        ZIGLANG.require(f"compiles units for {', '.join(platforms)}")
    written: tuple[Path, ...] = ()
    control, estimation = plan.options.control, plan.options.estimation
    try:
        if control is not None:
            name = f"{plan.prefix}_mpc"
            known = trained(control, _own(control.program, weights))
            unit = controller_unit(known, name, plan.float_type)
            written += write_online_unit(
                control.program, unit, sources(name), place, platforms, identity=identity(name)
            )
        if estimation is not None:
            name = f"{plan.prefix}_{'ekf' if estimation.window is None else 'mhe'}"
            own = _own(estimation.program, weights)
            unit = filter_unit(estimation, own, about(name))
            written += write_online_unit(
                estimation.program, unit, sources(name), place, platforms, identity=identity(name)
            )
    except CompilerFailedError as error:
        raise UnfitCompilerError(error.compiler, error.said, error.remedy) from None
    return (*written, *write_headers(place))


def _readme(plan: ExportPlan[Online]) -> str:
    from backends.files.text_templates import one_line, readme_text

    has_control = plan.options.control is not None
    estimation = plan.options.estimation
    has_filter = estimation is not None and estimation.window is None
    has_window = estimation is not None and estimation.window is not None
    parts = [
        ("a predictive controller", has_control),
        ("a Kalman filter", has_filter),
        ("a moving-horizon estimator", has_window),
    ]
    return readme_text(
        "mpc",
        model=one_line(plan.program.name),
        what=" and ".join(name for name, there in parts if there),
        prefix=plan.prefix,
        dtype=plan.dtype,
        controller=has_control,
        filter=has_filter,
        window=has_window,
        units="fmu" in plan.options.extras,
    )


def _own(program: Program, weights: Weights) -> Weights:
    known = {parameter.name for parameter in program.parameters}
    return {name: values for name, values in weights.items() if name in known}


def _load(plan: ExportPlan[Online], written: Written) -> NoReturn:
    raise AssertionError("a controller is judged by its plans, not by its steps")


def _compare(plan: ExportPlan[Online], weights: Weights, written: Written) -> Agreement:
    from msnn.exports.running.built_c import built_folder
    from msnn.features.control.export.judged_controller import compare_controller
    from msnn.features.control.export.judged_estimator import (
        compare_filter,
        compare_horizon,
        joined,
    )
    from msnn.features.control.export.judged_units import (
        compare_controller_units,
        compare_estimator_units,
    )

    units = "fmu" in plan.options.extras
    if units:
        FMPY.require("runs the units of a controller")
    found: list[Agreement] = []
    control, estimation = plan.options.control, plan.options.estimation
    with built_folder(written, "controller.so") as folder:
        if control is not None:
            own = _own(control.program, weights)
            judges = [compare_controller, *([compare_controller_units] if units else [])]
            # plans by their conditions, units by the bits of the C
            found += [judge(control, own, folder, plan.float_type, TARGET.name) for judge in judges]
        if estimation is not None:
            own = _own(estimation.program, weights)
            compare = compare_filter if estimation.window is None else compare_horizon
            judges = [compare, *([compare_estimator_units] if units else [])]
            kind = plan.float_type
            found += [judge(estimation, own, folder, kind, TARGET.name) for judge in judges]
    return joined(found)


def _tell(plan: ExportPlan[Online], folder: Path) -> str:
    """A sentence if a self-test of the export has no recorded bits, because no C compiler was
    available; else empty.
    """
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
    without_section=predictive_control.no_control,
    tell=_tell,
)
