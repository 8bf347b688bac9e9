"""Checks all data of a spec: their faults, and the information they contain."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import cast

import numpy as np

from msnn.data.dataset import Dataset, FloatArray
from msnn.data.reading.frames import Frames
from msnn.features.data_check.advice import (
    dynamics_findings,
    reading_findings,
    sampling_findings,
    signal_findings,
)
from msnn.features.data_check.channels import (
    Channel,
    RowsOfData,
    channels_of,
    frames_as_recorded,
    frames_resampled,
    read_as_recorded,
    read_resampled,
    rows_of,
)
from msnn.features.data_check.dynamics.check import check_inputs, check_target
from msnn.features.data_check.found import (
    CheckedChannel,
    CheckedSystem,
    CheckedTarget,
    DataCheck,
    DatasetCheck,
    targets_of,
)
from msnn.features.data_check.sampling import sampling_of
from msnn.features.data_check.signals import check_series, rounding, spikes, without_spikes
from msnn.model.model import Model
from msnn.simulation.simulation_data import GivenData, given_files
from spec_schema.diagnostics.diagnostic import Findings


def check_data(
    model: Model, data: GivenData | None = None, data_root: str | Path | None = None
) -> DataCheck:
    """Checks the data of a model, or `data` (files or frames) instead.

    Raises SpecError if the data cannot be read at all, and MissingExtraError.
    """
    files = None if data is None else given_files(data)
    if data is not None and files is None:
        frames = cast("Frames", data)
        return check_datasets(
            model, {"data": frames_as_recorded(model, frames)}, frames_resampled(model, frames)
        )
    recorded = read_as_recorded(model, files, data_root)
    return check_datasets(model, recorded, read_resampled(model, files, data_root))


def check_datasets(
    model: Model, recorded: Mapping[str, Dataset], resampled: Dataset | None = None
) -> DataCheck:
    """Checks datasets; the system is identified from the first, or from `resampled`."""
    findings = Findings()
    checked: list[DatasetCheck] = []
    predicted = targets_of(model.program)
    for name, dataset in recorded.items():
        checked.append(_dataset(model, name, dataset, resampled=resampled is not None))
        findings.report(*dataset.warnings)
        findings.report(*sampling_findings(model, checked[-1], resampled=resampled is not None))
        findings.report(*signal_findings(checked[-1], _ends_episodes(model), predicted))
    if resampled is not None:
        told = set(findings.in_order)
        findings.report(*(said for said in resampled.warnings if said not in told))
    system = None
    if model.program.sample_time is not None:
        step = _step(checked[0], model.program.sample_time)
        # data that are resampled have the step of the model, whatever was recorded
        if resampled is not None:
            step = model.program.sample_time
        system = _system(model, resampled or next(iter(recorded.values())), step)
        findings.report(*dynamics_findings(system, resampled=resampled is not None))
        findings.report(*reading_findings(model, system))
    return DataCheck(
        sample_time=model.program.sample_time,
        datasets=tuple(checked),
        system=system,
        findings=findings.in_order,
    )


def _ends_episodes(model: Model) -> str | None:
    """The key of the spec that ends an episode where an input is missing; None without one."""
    data = model.spec.data
    return None if data is None or data.nan == "error" else f"nan: {data.nan}"


def _dataset(model: Model, name: str, dataset: Dataset, *, resampled: bool) -> DatasetCheck:
    rows = rows_of(dataset)
    to = model.program.sample_time if resampled else None
    pieces = [piece for record in dataset.records for piece in record.pieces]
    return DatasetCheck(
        name=name,
        sampling=tuple(found for piece in pieces if (found := sampling_of(piece)) is not None),
        channels=tuple(
            CheckedChannel(
                one, check_series(one.values, rows.follows, one.missing, int(one.left_out.sum()))
            )
            for one in channels_of(model.program, dataset, to)
        ),
        rows=rows,
    )


def _step(checked: DatasetCheck, otherwise: float) -> float:
    """Seconds between recorded rows."""
    steps = [one.step for one in checked.sampling if np.isfinite(one.step)]
    return float(np.median(steps)) if steps else otherwise


def _system(model: Model, dataset: Dataset, step: float) -> CheckedSystem:
    rows = rows_of(dataset)
    channels = list(channels_of(model.program, dataset))
    wanted = targets_of(model.program)
    # an input without any value would leave no row to look at
    inputs = [
        channel
        for channel in channels
        if channel.signal.name not in wanted and np.isfinite(channel.values).any()
    ]
    table = np.zeros((dataset.rows, len(inputs)))
    for column, channel in enumerate(inputs):
        table[:, column] = _clean(channel, rows)
    names = [channel.name for channel in inputs]
    about = check_inputs(table, rows.follows, [rounding(channel.values) for channel in inputs])
    return CheckedSystem(
        step=step,
        inputs=tuple(inputs),
        about=about,
        targets=tuple(
            CheckedTarget(
                channel,
                wanted[channel.signal.name],
                check_target(_clean(channel, rows), table, rows.follows, about, names),
            )
            for channel in channels
            if channel.signal.name in wanted
        ),
    )


def _clean(channel: Channel, rows: RowsOfData) -> FloatArray:
    # a spike would be an impulse to which nothing answers
    return without_spikes(channel.values, spikes(channel.values, rows.follows))
