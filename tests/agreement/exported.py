"""Programs as exports of any target, written and compared with the judge."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from compiler.ir.program import Program
from msnn.agreement.agreement import Agreement
from msnn.agreement.judgement import AgreementRecord, FloatType, drawn_record
from msnn.data.dataset import FloatArray
from msnn.exports.check import check_export
from msnn.exports.export import target_named, write_export
from msnn.exports.target import AnyPlan, ExportPlan


def plan_of(target: str, program: Program, dtype: FloatType) -> AnyPlan:
    """The plan of a program in step form as it is, with the usual options of the target."""
    named = target_named(target)
    return ExportPlan(
        target=named, program=program, prefix="model", dtype=dtype, options=named.options
    )


def checked(
    plan: AnyPlan,
    weights: Mapping[str, FloatArray],
    folder: Path,
    record: AgreementRecord | None = None,
    *,
    written: Mapping[str, FloatArray] | None = None,
) -> Agreement:
    """What `export --check` says of it, along drawn numbers unless there is a record.

    Weights that are `written` in place of `weights` must be found.
    """
    export = write_export(plan, weights if written is None else written, folder)
    return check_export(plan, weights, export, record or drawn_record(plan.program, "drawn"))
