"""Runs what was written for every target along a record of the model, beside its judge."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from msnn.agreement.agreement import Agreement
from msnn.agreement.compare import compare
from msnn.agreement.judging.record import AgreementRecord, agreement_record
from msnn.agreement.report import AgreementReport, Failure
from msnn.agreement.subject import Subject
from msnn.errors.failures import NotRunHereError
from msnn.exports.export import load_export
from msnn.exports.target import AnyPlan, Weights, Written
from msnn.model.model import Model

_DRAWN = "drawn samples"
"""What targets are compared along that have no record: plans have references, data have none."""


def check_exports(
    model: Model,
    exports: Sequence[tuple[AnyPlan, Written]],
    weights: Weights,
    data_folder: Path,
) -> AgreementReport:
    """Compares the written files of every plan with its judge along a record of the model.

    Relative data paths start in `data_folder`. A target that needs something which is not
    installed, or that fails, does not keep the others from being compared: the report has the
    error, and it is for the caller to raise it when the report is printed.
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
    """What a runtime does not implement is no fault of the export: onnxruntime lacks operators for
    some types, CasADi's interface some calls. They name it alike.
    """
    if type(error).__name__ not in ("NotImplementedError", "NotImplemented"):
        return error
    named = NotRunHereError(plan.target.name, " ".join(str(error).split()) or "not implemented")
    named.__cause__ = error
    return named


def check_export(
    plan: AnyPlan, weights: Weights, written: Written, record: AgreementRecord | None
) -> Agreement:
    """The same of one target; one that draws its samples itself (`compare`) needs no record.

    MissingExtraError where it needs what is not installed.
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
