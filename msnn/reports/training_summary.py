"""Summarises a training: stages with losses, learned parameters with units."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from compiler.ir.program import Program
from msnn.data.dataset import FloatArray
from msnn.tables import Table
from msnn.training.records.learned.parameters_record import has_unidentified, parameters_record
from msnn.training.records.learned.standard_errors import StandardErrors
from msnn.training.records.progress import EpochEnd, Progress, StageEnd, StageStart, leading_epochs
from msnn.validation.reports.words import difference_text, unit_of_record
from spec_schema.diagnostics.diagnostic import Diagnostic

_MOST_SHOWN = 8


class Recorded:
    """A receiver of progress that forwards events, and records the end of each stage with its
    losses.

    With `keeps_epochs` it records all epochs, for a run without files.
    """

    def __init__(self, shown: Progress, *, keeps_epochs: bool = False) -> None:
        self.shown = shown
        self.stages: list[tuple[StageEnd, Mapping[str, float]]] = []
        self._losses: dict[int, dict[str, float]] = {}
        self._epochs: dict[str, dict[int, list[EpochEnd]]] = {}
        self._keeps_epochs = keeps_epochs

    def stage_started(self, event: StageStart) -> None:
        self._losses = {}
        self.shown.stage_started(event)

    def epoch_ended(self, event: EpochEnd) -> None:
        self._losses[event.attempt] = event.losses
        if self._keeps_epochs:
            self._epochs.setdefault(event.stage, {}).setdefault(event.attempt, []).append(event)
        self.shown.epoch_ended(event)

    def stage_ended(self, event: StageEnd) -> None:
        self.stages.append((event, self._losses.get(event.attempt, {})))
        self.shown.stage_ended(event)

    def warned(self, diagnostic: Diagnostic) -> None:
        self.shown.warned(diagnostic)

    @property
    def epochs(self) -> tuple[tuple[EpochEnd, ...], ...]:
        """The epochs of every stage that has begun, for the leading attempt."""
        return tuple(tuple(leading_epochs(attempts.values())) for attempts in self._epochs.values())


def stages_table(stages: Sequence[tuple[StageEnd, Mapping[str, float]]]) -> str:
    """The results of the stages as a printed table; see `stages_cells`."""
    return stages_cells(stages).text


def stages_cells(stages: Sequence[tuple[StageEnd, Mapping[str, float]]]) -> Table:
    """A table with one row per stage: the best monitor, and the training losses of the last
    epoch.
    """
    losses = list(dict.fromkeys(name for _, found in stages for name in found))
    rows = [
        (
            end.stage,
            str(end.epochs),
            f"{end.best:.6g}",
            str(end.best_epoch),
            *(f"{found[name]:.6g}" if name in found else "" for name in losses),
            end.reason,
        )
        for end, found in stages
    ]
    header = ("stage", "epochs", "best total", "at epoch", *(f"last {n}" for n in losses), "ended")
    return Table(header, rows, numbers=range(1, len(header) - 1))


def parameters_table(record: Mapping[str, Any]) -> str:
    """The learned parameters as a printed table; see `parameters_cells`."""
    return parameters_cells(record).text


def parameters_cells(record: Mapping[str, Any]) -> Table:
    """One row per parameter: initial value, learned value and standard error, in its unit.

    The standard error of a temperature in degC is in K. `record` is that of `parameters_record`.
    """
    rows = [
        (
            found["name"],
            found["unit"] or "",
            _values(found["initial"]),
            _values(found["values"]),
            difference_text(_errors(found["standard_errors"]), unit_of_record(found["unit"])),
            _remark(record, found),
        )
        for found in record["parameters"]
    ]
    header = ("parameter", "unit", "initial", "learned", "std. error", "remark")
    return Table(header, rows)


def errors_note(record: Mapping[str, Any]) -> str | None:
    """The basis of the standard errors, or the reason for missing ones; None if not computed."""
    found = record.get("standard_errors")
    if found is None:
        return None
    if found["reason"] is not None:
        return f"no standard errors: {found['reason']}"
    noise = ", ".join(f"{name} {sigma:.3g}" for name, sigma in found["noise"].items())
    return (
        f"standard errors from {found['residuals']} residuals taken as white (σ: {noise}); "
        "correlated residuals make the true ones larger"
    )


def zeros_note(record: Mapping[str, Any]) -> str | None:
    """A text about elements that penalties set to exactly 0; None if there are none."""
    if "zero_slices" not in record:
        return None
    said: list[str] = []
    for found in record["zero_slices"]:
        array, size, zero = found["array"], found["of"], found["zero"]
        if found["over"] is None:
            said.append(f"{zero} of the {size} numbers of {array}")
            continue
        axis = found["over"].rpartition(".")[2]
        named = ", ".join(str(name) for name in zero)
        said.append(f"{len(zero)} of the {size} slices of {array} over {axis} ({named})")
    kept = any(each["over"] is None and each["zero"] < each["of"] for each in record["zero_slices"])
    rest = " (of single numbers those that are whole slices)" if kept else ""
    return f"exactly 0 and left out of exports{rest}: {'; '.join(said)}"


def training_record(
    program: Program,
    weights: Mapping[str, FloatArray],
    recorded: Recorded,
    found: StandardErrors | None = None,
) -> dict[str, Any]:
    """The stages, losses and parameters of a training as a JSON object."""
    return {
        "stages": [
            {
                "name": end.stage,
                "epochs": end.epochs,
                "best": end.best,
                "best_epoch": end.best_epoch,
                "losses": found,
                "seconds": end.seconds,
                "ended": end.reason,
                "run": end.attempt,
                "runs": end.attempts,
            }
            for end, found in recorded.stages
        ],
        **parameters_record(program, weights, found),
    }


def _values(values: Sequence[float | None]) -> str:
    known = [value for value in values if value is not None]
    if len(values) > _MOST_SHOWN and known:
        return f"{len(values)} numbers, {min(known):.4g} … {max(known):.4g}"
    return ", ".join("–" if value is None else f"{value:.6g}" for value in values)


def _errors(errors: Sequence[float | None] | None) -> str:
    if errors is None or len(errors) > _MOST_SHOWN or not any(e is not None for e in errors):
        return ""
    return ", ".join("–" if e is None else f"{e:.2g}" for e in errors)


def _remark(record: Mapping[str, Any], found: Mapping[str, Any]) -> str:
    if not found["learn"]:
        return "fixed"
    if found["at_bound"]:
        return "at its bound"
    return "not identifiable" if has_unidentified(record, found) else ""
