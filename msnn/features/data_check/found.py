"""Defines the results of a data check."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from compiler.ir.program import Program, Role
from msnn.features.data_check.channels import Channel, RowsOfData
from msnn.features.data_check.dynamics.check import InputsCheck, TargetCheck
from msnn.features.data_check.sampling import StepsOfTime
from msnn.features.data_check.signals import SeriesCheck
from spec_schema.diagnostics.diagnostic import Diagnostic


@dataclass(frozen=True, slots=True)
class CheckedChannel:
    """One series and its own properties."""

    channel: Channel
    found: SeriesCheck


@dataclass(frozen=True, slots=True, kw_only=True)
class DatasetCheck:
    """The results of one data section of the spec."""

    name: str
    """`data`, or the files of an entry of `validate`."""
    sampling: tuple[StepsOfTime, ...]
    """For every file with times."""
    channels: tuple[CheckedChannel, ...]
    rows: RowsOfData


@dataclass(frozen=True, slots=True)
class CheckedTarget:
    """One predicted series; `ahead` is the prediction horizon of the output."""

    channel: Channel
    ahead: int | None
    found: TargetCheck

    @property
    def moves(self) -> bool:
        known = self.channel.values[np.isfinite(self.channel.values)]
        return len(known) > 0 and float(np.ptp(known)) > 0


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckedSystem:
    """The system between inputs and targets, as identified from the section `data`."""

    step: float
    """Seconds between its rows."""
    inputs: tuple[Channel, ...]
    about: InputsCheck
    targets: tuple[CheckedTarget, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class DataCheck:
    """All findings, and the suggested changes."""

    sample_time: float | None
    datasets: tuple[DatasetCheck, ...]
    system: CheckedSystem | None
    """None for a static model."""
    findings: tuple[Diagnostic, ...]


def targets_of(program: Program) -> Mapping[str, int | None]:
    """Predicted signals with their prediction horizon, and signals that only training reads."""
    found: dict[str, int | None] = {
        signal.name: None for signal in program.signals if signal.role is Role.TARGET
    }
    for output in program.outputs:
        if output.predicts is not None:
            known = {signal.name for signal in program.signals}
            # a state that is predicted and not logged has no signal
            if output.predicts.signal in known:
                found[output.predicts.signal] = output.predicts.ahead
    return found
