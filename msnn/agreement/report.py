"""Checks all exports of a model and prints how well they agree with the judge."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from msnn.agreement.compare import Agreement, Fault, compare
from msnn.agreement.record import agreement_record
from msnn.data.dataset import FloatArray
from msnn.errors import commands
from msnn.errors.failures import MissingExtraError
from msnn.exports.export import ExportPlan
from msnn.model.model import Model
from msnn.tables import table_text
from spec_schema.diagnostics.diagnostic import Diagnostic


@dataclass(frozen=True, slots=True)
class Failure:
    """A target whose comparison came to no end, and why."""

    target: str
    dtype: str
    error: Exception

    @property
    def row(self) -> tuple[str, ...]:
        """Its row of the table."""
        missing = isinstance(self.error, MissingExtraError)
        why = "not compared" if missing else f"FAILED: {type(self.error).__name__}"
        return self.target, self.dtype, "", "", "", "", why


@dataclass(frozen=True, slots=True)
class AgreementReport:
    """What each target's comparison gave, and what kept others from being compared."""

    origin: str
    """The record along which they were compared."""
    rows: tuple[Agreement, ...]
    failures: tuple[Failure, ...]

    @property
    def missing(self) -> tuple[MissingExtraError, ...]:
        """What is not installed and kept targets from being compared."""
        errors = (failure.error for failure in self.failures)
        return tuple(error for error in errors if isinstance(error, MissingExtraError))

    @property
    def first_error(self) -> Exception | None:
        """What ended the comparison of a target although everything that it needs is there."""
        errors = (failure.error for failure in self.failures)
        return next((e for e in errors if not isinstance(e, MissingExtraError)), None)

    @property
    def agrees(self) -> bool:
        return all(row.agrees for row in self.rows)


def check_exports(
    model: Model,
    plans: Sequence[ExportPlan],
    weights: Mapping[str, FloatArray],
    written: Mapping[str, tuple[Path, Sequence[Path]]],
    data_folder: Path,
) -> AgreementReport:
    """Runs what was written for every plan along a record of the model.

    `written` has the folder and the files of each target.

    Relative data paths start in `data_folder`. A target that needs something which is not
    installed, or that fails, does not keep the others from being compared: the report has the
    error, and it is for the caller to raise it when the report is printed.
    """
    rows: list[Agreement] = []
    failures: list[Failure] = []
    origins: dict[str, None] = {}
    for plan in plans:
        record = agreement_record(model, plan.program, data_folder)
        origins[record.origin] = None
        try:
            folder, files = written[plan.target]
            rows.append(compare(plan, weights, files, folder, record))
        except Exception as error:  # noqa: BLE001  (raised again once the table is printed)
            failures.append(Failure(plan.target, plan.fixed_point or plan.dtype, error))
    return AgreementReport(", ".join(origins), tuple(rows), tuple(failures))


def agreement_table(report: AgreementReport) -> str:
    """One row a target, failed ones last; deviations are relative to the largest of each signal."""
    rows = [
        (
            row.target,
            row.dtype,
            str(row.steps),
            "" if row.one_step is None else f"{row.one_step:.1e}",
            f"{row.free_run:.1e}",
            "" if row.bits is None else str(row.bits),
            "agrees" if row.agrees else "DIFFERS",
        )
        for row in report.rows
    ]
    rows += [failure.row for failure in report.failures]
    header = ("target", "type", "steps", "one step", "free run", "differing bits", "")
    table = table_text(header, rows, numbers=[2, 3, 4, 5])
    return f"Worst deviation from the interpreter in float64, along {report.origin}:\n{table}"


def agreement_diagnostics(report: AgreementReport) -> list[Diagnostic]:
    """Where targets break their promise, and values that single precision cannot hold well."""
    found: list[Diagnostic] = []
    for row in report.rows:
        found += [
            commands.target_differs(row.target, row.dtype, fault.of, _difference(fault))
            for fault in row.faults
        ]
        if row.agrees:
            found += [
                commands.costly_rounding(row.target, of, error)
                for of, error in row.rounding.items()
            ]
    return found


def _difference(fault: Fault) -> str:
    if fault.deviation is None or fault.limit is None:
        return f"{fault.bits} values have other bits"
    return (
        f"a step is off by {fault.deviation:.1e} of the largest magnitude, "
        f"where rounding explains {fault.limit:.1e}"
    )


def agreement_values(report: AgreementReport) -> dict[str, Any]:
    """The same as JSON values."""
    return {
        "along": report.origin,
        "agrees": report.agrees,
        "targets": [{**asdict(row), "agrees": row.agrees} for row in report.rows],
        "not_checked": [str(failure.error) for failure in report.failures],
    }
