"""What a training reached: its stages with their losses, and the learned parameters with units."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from compiler.program import Parameter, Program
from msnn.data.dataset import FloatArray
from msnn.tables import table_text
from msnn.training.progress import EpochEnd, Progress, StageEnd, StageStart
from spec_schema.diagnostics import Diagnostic
from spec_schema.errors.training import at_bound

_AT_BOUND = 1e-3
"""Part of the range within which a value counts as at its bound."""
_MOST_SHOWN = 8


class Recorded:
    """Passes every event on and keeps how each stage ended, with the losses of its last epoch."""

    def __init__(self, shown: Progress) -> None:
        self.shown = shown
        self.stages: list[tuple[StageEnd, dict[str, float]]] = []
        self._losses: dict[int, dict[str, float]] = {}

    def stage_started(self, event: StageStart) -> None:
        self._losses = {}
        self.shown.stage_started(event)

    def epoch_ended(self, event: EpochEnd) -> None:
        self._losses[event.attempt] = event.losses
        self.shown.epoch_ended(event)

    def stage_ended(self, event: StageEnd) -> None:
        self.stages.append((event, self._losses.get(event.attempt, {})))
        self.shown.stage_ended(event)

    def warned(self, diagnostic: Diagnostic) -> None:
        self.shown.warned(diagnostic)


def stages_table(recorded: Recorded) -> str:
    """One row a stage: the best total on what is watched, the last losses on the training data."""
    losses = list(dict.fromkeys(name for _, found in recorded.stages for name in found))
    rows = [
        (
            end.stage,
            str(end.epochs),
            f"{end.best:.6g}",
            str(end.best_epoch),
            *(f"{found[name]:.6g}" if name in found else "" for name in losses),
            end.reason,
        )
        for end, found in recorded.stages
    ]
    header = ("stage", "epochs", "best total", "at epoch", *(f"last {n}" for n in losses), "ended")
    return table_text(header, rows, numbers=range(1, len(header) - 1))


def parameters_table(program: Program, weights: Mapping[str, FloatArray]) -> str:
    """One row a parameter: where it began, what it is now, both in its unit."""
    rows = [
        (
            parameter.name,
            "" if parameter.unit is None else parameter.unit.text,
            _values(parameter.initial),
            _values(weights[parameter.name].ravel().tolist()),
            _remark(parameter, weights[parameter.name]),
        )
        for parameter in program.parameters
    ]
    return table_text(("parameter", "unit", "initial", "learned", "remark"), rows)


def bound_warnings(program: Program, weights: Mapping[str, FloatArray]) -> list[Diagnostic]:
    """A warning for every learned parameter that ended at a bound."""
    return [
        at_bound(parameter.name, parameter.span)
        for parameter in program.parameters
        if parameter.learn and _at_bound(parameter, weights[parameter.name])
    ]


def training_record(
    program: Program, weights: Mapping[str, FloatArray], recorded: Recorded
) -> dict[str, Any]:
    """The same as JSON values."""
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
        "parameters": [
            {
                "name": parameter.name,
                "unit": parameter.unit and parameter.unit.text,
                "shape": [axis.size for axis in parameter.axes],
                "values": weights[parameter.name].ravel().tolist(),
            }
            for parameter in program.parameters
        ],
    }


def _values(values: tuple[float, ...] | list[float]) -> str:
    if len(values) > _MOST_SHOWN:
        return f"{len(values)} numbers, {min(values):.4g} … {max(values):.4g}"
    return ", ".join(f"{value:.6g}" for value in values)


def _remark(parameter: Parameter, value: FloatArray) -> str:
    if not parameter.learn:
        return "fixed"
    return "at its bound" if _at_bound(parameter, value) else ""


def _at_bound(parameter: Parameter, value: FloatArray) -> bool:
    low, high = parameter.minimum, parameter.maximum
    span = high - low if low is not None and high is not None else abs(parameter.scale)
    near_low = low is not None and bool((value - low < _AT_BOUND * span).any())
    near_high = high is not None and bool((high - value < _AT_BOUND * span).any())
    return near_low or near_high
