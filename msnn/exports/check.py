"""Runs the files of every target on recorded inputs, and compares them with the reference."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from msnn.agreement.agreement import Agreement
from msnn.agreement.compare import compare
from msnn.agreement.judgement import AgreementRecord, agreement_record
from msnn.agreement.report import AgreementReport, Failure
from msnn.agreement.subject import Subject
from msnn.errors.failures import NotRunHereError
from msnn.exports.export import load_export
from msnn.exports.target import AnyPlan, Weights, Written
from msnn.model.model import Model

_DRAWN = "drawn samples"
"""Origin of inputs for targets that are not compared on data."""


def check_exports(
    model: Model,
    exports: Sequence[tuple[AnyPlan, Written]],
    weights: Weights,
    data_folder: Path,
) -> AgreementReport:
    """Compares the written files of every plan with its reference on recorded inputs.

    Relative data paths start in `data_folder`. If a target fails or needs a missing package, the
    others are still compared. The report contains the error, and the caller raises it after
    printing.
    """
    rows: list[Agreement] = []
    failures: list[Failure] = []
    origins: dict[str, None] = {}
    for plan, written in exports:
        try:
            record = None
            if plan.target.compare is None:
                # of each target by itself: they may close other loops, and read other signals then
                record = agreement_record(model, plan.program, data_folder)
            origins[_DRAWN if record is None else record.origin] = None
            rows.append(check_export(plan, weights, written, record))
        except Exception as error:  # noqa: BLE001  (raised again once the table is printed)
            failures.append(Failure(plan.target.name, plan.dtype, _named(plan, error)))
    return AgreementReport(", ".join(origins), tuple(rows), tuple(failures))


def _named(plan: AnyPlan, error: Exception) -> Exception:
    """The error; a NotRunHereError if a runtime lacks an operation that the export uses.

    That is no fault of the export: onnxruntime lacks operators for some types, CasADi's interface
    some calls.
    """
    if type(error).__name__ not in ("NotImplementedError", "NotImplemented"):
        return error
    named = NotRunHereError(plan.target.name, " ".join(str(error).split()) or "not implemented")
    named.__cause__ = error
    return named


def check_export(
    plan: AnyPlan, weights: Weights, written: Written, record: AgreementRecord | None
) -> Agreement:
    """Compares one target; a target with `compare` needs no recorded inputs.

    Raises MissingExtraError if a required package is not installed.
    """
    target, weights = plan.target, plan.of(weights)
    if target.compare is not None:
        return target.compare(plan, weights, written)
    assert record is not None
    subject = Subject(
        target=target.name,
        dtype=plan.dtype,
        program=plan.program,
        weights=weights,
        promise=target.promise(plan.dtype),
        judge=lambda dtype: target.judge(plan, weights, record, dtype),
        restarts=target.is_deployed,
    )
    with load_export(plan, written) as loaded:
        return compare(subject, loaded, record)
