"""Takes one spec through check, compile, every export and a training kernel, against the judge."""

from __future__ import annotations

import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Protocol, TypeAlias
from unittest.mock import patch

import numpy as np
from fmpy import validation

from backends.c.selftest import selftest_text
from backends.c.selftest.singles import golden_singles
from backends.fmu import binary
from backends.native import compile_kernel
from compiler.ir.program import Program
from compiler.program_file.file import program_from_json, program_to_json
from msnn.agreement.judge import judge
from msnn.agreement.judgement import AgreementRecord, drawn_record
from msnn.agreement.subject import worst_deviation
from msnn.data.dataset import FloatArray
from msnn.exports.check import check_export
from msnn.exports.export import plan_exports, write_export
from msnn.exports.table import NAMES
from msnn.exports.target import AnyPlan
from msnn.model.load import load_model
from msnn.model.model import Model
from msnn.model.weights.weights_file import initial_weights
from msnn.reports.diagram.mermaid import mermaid_text
from msnn.reports.latex import latex_text
from msnn.reports.show import interface_text, windows_text
from msnn.verification import host_checks
from msnn.verification.exported_c import read_exported_c
from msnn.verification.harness import differences
from spec_schema.diagnostics.diagnostic import Findings, SpecError
from spec_schema.editors.format_spec import format_spec
from spec_schema.editors.spec_data import spec_data
from spec_schema.reading.reader import read_spec
from spec_schema.yaml_tree.writer import yaml_text
from tests.random_specs.kernel_trial import kernel_fault, stage_to_train

STEPS = 24
"""Steps that are compared: four times the longest window."""

ROUNDINGS = 100 * 2.0**-29
"""What of the judge's deviation in float32 a backend may have in float64: its roundings are 2⁻²⁹ as
large, and up to 100 times as many where it computes in another order."""


@dataclass(frozen=True, slots=True)
class Fault:
    """What went wrong, where, and what tells it from other faults."""

    stage: str
    kind: str
    """The same for the same fault of a smaller spec."""
    detail: str


WeightsOf: TypeAlias = Callable[[Program], Mapping[str, FloatArray]]


class Texts(Protocol):
    """A spec as the texts of its files."""

    def texts(self) -> Mapping[str, str]: ...


def fault_of(
    spec: Texts,
    *,
    targets: Sequence[str] = NAMES,
    kernel: bool = True,
    searches: bool = True,
    weights_of: WeightsOf = initial_weights,
    compared: Counter[str] | None = None,
) -> Fault | None:
    """The first thing that is wrong with the treatment of a spec; None where all is well.

    `weights_of` gives the weights that are exported; the training kernel begins at initial ones.

    `searches`: whether steps are searched for the test program that an export of C brings along.
    `compared` counts what was compared: targets, and `kernel` for a training.
    """
    largest = golden_singles._LARGEST if searches else 0
    compared = Counter() if compared is None else compared
    with (
        TemporaryDirectory(prefix="msnn-spec-") as place,
        warnings.catch_warnings(),
        # what takes most of the time and is judged elsewhere: many steps of the test program that
        # an export brings along, and the last tenths of the speed of kernels and units
        patch.object(selftest_text, "_TEST_STEPS", 1),
        patch.object(selftest_text, "SELFTEST_STEPS", 1),
        patch.object(golden_singles, "_LARGEST", largest),
        patch.object(validation, "_validate_variable_names", _problems_of_names),
        patch.object(compile_kernel, "LANES_BY_GCC", ("-O1",)),
        patch.object(binary, "FLAGS", _quick(binary.FLAGS)),
    ):
        warnings.simplefilter("error")
        folder = Path(place)
        for name, text in spec.texts().items():
            (folder / name).write_text(text, encoding="utf-8")
        stage = "check"
        try:
            model = load_model(folder / "spec.msnn.yaml")
            stage = "show"
            _shown(model)
            if targets:
                stage = "export"
                fault = _exported(model, targets, folder, weights_of(model.program), compared)
                if fault is not None:
                    return fault
            stage = "train"
            plan = stage_to_train(model) if kernel and model.spec.train else None
            if plan is not None:
                found = kernel_fault(plan)
                compared["kernel"] += 1
                if found is not None:
                    return Fault(stage, *found)
        except SpecError as error:
            codes = sorted({d.code for d in error.diagnostics if d.severity == "error"})
            said = "\n".join(d.message for d in error.diagnostics)
            return Fault(stage, "refused: " + " ".join(codes), said)
        except Exception as error:  # noqa: BLE001  (whatever it is, it is what we look for)
            last = traceback.extract_tb(error.__traceback__)[-1]
            kind = f"{type(error).__name__} in {Path(last.filename).name}: {last.name}"
            return Fault(stage, kind, "".join(traceback.format_exception(error)))
    return None


_NAMES_OF_UNITS: Callable[[Any], list[str]] = validation._validate_variable_names
_right_names = set[tuple[str, str]]()


def _problems_of_names(description: Any) -> list[str]:
    """What FMPy says of the names of variables in a unit: of each name once, as its parser takes
    more time than all else that is done with a unit."""
    kind: str = description.variableNamingConvention
    new = copy(description)
    new.modelVariables = [
        variable
        for variable in description.modelVariables
        if (kind, variable.name) not in _right_names
    ]
    problems = _NAMES_OF_UNITS(new) if new.modelVariables else []
    if not problems:
        _right_names.update((kind, variable.name) for variable in new.modelVariables)
    return problems


def _quick(flags: tuple[str, ...]) -> tuple[str, ...]:
    return tuple("-O0" if flag == "-O2" else flag for flag in flags)


def _shown(model: Model) -> None:
    """What `show`, `fmt` and `compile` make of the model is well-formed and means the same."""
    mermaid_text(model.spec)
    latex_text(model.spec)
    interface_text(model.program)
    windows_text(model.program)
    once = format_spec(str(model.path), model.text)
    assert format_spec(str(model.path), once) == once, "`fmt` is not stable"
    text = program_to_json(model.program)
    assert program_to_json(program_from_json(text, "random")) == text, "a program file changes"
    resolved = yaml_text(spec_data(model.read.spec))
    again = read_spec(model.path, resolved)
    assert yaml_text(spec_data(again.spec)) == resolved, "`show --resolved` reads differently"


def _exported(
    model: Model,
    targets: Sequence[str],
    folder: Path,
    weights: Mapping[str, FloatArray],
    compared: Counter[str],
) -> Fault | None:
    findings = Findings()
    plans = plan_exports(model, targets, findings, (), weights)
    findings.raise_errors()
    for plan in plans:
        target = plan.target.name
        with np.errstate(all="ignore"):
            written = write_export(plan, weights, folder / target)
            record = _record(plan)
            found = check_export(plan, weights, written, record)
            compared[target] += 1
            if plan.target.is_verified:
                different = _golden_differences(folder / target)
                if different:
                    return Fault(target, "golden steps", "\n".join(different))
            if found.bits:
                said = f"{found.bits} values differ in bits from the judge"
                return Fault(target, "bits", said)
            slopes = [fault for fault in found.faults if fault.of.startswith("the matrix")]
            if slopes:
                return Fault(target, "slopes", str(slopes))
            if plan.dtype == "float32" or found.agrees:
                continue  # in float32 the bits say more than any limit
            allowed = ROUNDINGS * _rounding(plan, plan.of(weights), record)
            if found.one_step is None or not found.one_step <= allowed:
                return Fault(target, "differs", f"{found} (allowed {allowed:.1e})")
    return None


def _golden_differences(folder: Path) -> list[str]:
    """What the test program that an export brings along answers wrongly, built by gcc."""
    exported = read_exported_c(folder)
    with TemporaryDirectory(prefix="msnn-golden-") as place:
        return differences(exported, host_checks._replay("gcc", ["-O0"], exported, Path(place)))


def _record(plan: AnyPlan) -> AgreementRecord:
    found = drawn_record(plan.program, "drawn numbers")
    return AgreementRecord(found.log, found.t0, min(found.steps, STEPS), found.origin)


def _rounding(plan: AnyPlan, weights: Mapping[str, FloatArray], record: AgreementRecord) -> float:
    """How far the judge in float32 is from the judge in float64: how well the model is posed."""
    exact = judge(plan.program, weights, record, np.float64)
    rough = judge(plan.program, weights, record, np.float32)
    return max(
        worst_deviation(rough.outputs, exact.outputs),
        worst_deviation(rough.next_states, exact.next_states),
    )
