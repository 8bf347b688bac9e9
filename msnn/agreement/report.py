"""Reports the agreement of exports with the reference interpreter: table, messages, JSON."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from msnn.agreement.agreement import Agreement
from msnn.errors import commands
from msnn.errors.failures import MissingExtraError
from msnn.tables import table_text
from spec_schema.diagnostics.diagnostic import Diagnostic


@dataclass(frozen=True, slots=True)
class Failure:
    """A target whose comparison failed, with the error."""

    target: str
    dtype: str
    error: Exception

    def cells(self, place: int) -> tuple[str, ...]:
        """Its row of the table, with the reason in a column."""
        missing = isinstance(self.error, MissingExtraError)
        why = "not compared" if missing else f"FAILED: {type(self.error).__name__}"
        return self.target, self.dtype, *([""] * (place - 2)), why


@dataclass(frozen=True, slots=True)
class AgreementReport:
    """Results of the compared targets, and reasons why others were not compared."""

    origin: str
    """Origin of the inputs of the comparison."""
    rows: tuple[Agreement, ...]
    failures: tuple[Failure, ...]

    @property
    def missing(self) -> tuple[MissingExtraError, ...]:
        """Missing packages because of which targets were not compared."""
        errors = (failure.error for failure in self.failures)
        return tuple(error for error in errors if isinstance(error, MissingExtraError))

    @property
    def first_error(self) -> Exception | None:
        """The first error that is not a missing package."""
        errors = (failure.error for failure in self.failures)
        return next((e for e in errors if not isinstance(e, MissingExtraError)), None)

    @property
    def agrees(self) -> bool:
        return all(row.agrees for row in self.rows)


def agreement_table(report: AgreementReport) -> str:
    """One row per target, failed ones last; errors are relative to the largest value of each
    signal.
    """
    some = any(row.undecided for row in report.rows)
    rows = [_cells(row, with_undecided=some) for row in report.rows]
    rows += [failure.cells(8 if some else 7) for failure in report.failures]
    undecided = ("undecided",) if some else ()
    counted = ("steps", *undecided, "one step", "free run", "Jacobian", "differing bits")
    header = ("target", "type", *counted, "")
    table = table_text(header, rows, numbers=[2 + k for k in range(len(counted))])
    return f"Worst deviation from the interpreter in float64, along {report.origin}:\n{table}"


def _cells(row: Agreement, *, with_undecided: bool) -> tuple[str, ...]:
    undecided = str(max(row.undecided.values(), default=0))
    outcome = "agrees" if row.agrees else "DIFFERS"
    if row.untried:
        outcome += f", nothing compared of {', '.join(row.untried)}"
    return (
        row.target,
        row.dtype,
        str(row.steps),
        *((undecided if row.bits is None else "",) if with_undecided else ()),
        "" if row.one_step is None else f"{row.one_step:.1e}",
        f"{row.free_run:.1e}",
        "" if row.jacobian is None else f"{row.jacobian:.1e}",
        "" if row.bits is None else str(row.bits),
        outcome,
    )


def agreement_diagnostics(report: AgreementReport) -> list[Diagnostic]:
    """Diagnostics for broken promises, and for values with poor accuracy in float32."""
    found: list[Diagnostic] = []
    for row in report.rows:
        found += [
            commands.target_differs(row.target, row.dtype, fault.of, fault.difference)
            for fault in row.faults
        ]
        if row.agrees:
            found += [
                commands.costly_rounding(row.target, of, error)
                for of, error in row.rounding.items()
            ]
    return found


def agreement_values(report: AgreementReport) -> dict[str, Any]:
    """The results of the comparison as a JSON object."""
    return {
        "along": report.origin,
        "agrees": report.agrees,
        "targets": [{**asdict(row), "agrees": row.agrees} for row in report.rows],
        "not_checked": [str(failure.error) for failure in report.failures],
    }
