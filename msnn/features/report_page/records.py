"""Prepares simulated recordings for the page: measurements, simulation, errors, inputs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from compiler.ir.program import Program, Role, Signal
from compiler.ir.types import Type
from msnn.data.dataset import Dataset, FloatArray
from msnn.features.report_page.packing import Plain, finite, packed, rounding, series
from msnn.reports.drawn import DrawnNumber, channels, element_name, output_channels, shown_first
from msnn.simulation.simulate import Simulation
from msnn.validation.statistics.metrics import Errors, score

_EXACT = 400_000
"""Maximum number of values stored exactly: 2.1 MB of the page."""
_REST = 90_000
"""Maximum number of thinned values: half a megabyte."""
_POINTS = 1_200
"""Maximum points per series of a thinned recording."""
_FEWEST = 60
_MOST_RECORDS = 200
_SHARE = 0.01
"""Maximum rounding error relative to the RMSE, less than the width of a line."""


@dataclass(frozen=True, slots=True)
class Records:
    """The recordings that the page shows, as JSON objects, and texts about omitted ones."""

    shown: list[Plain]
    left_out: list[str]


@dataclass(frozen=True, slots=True, kw_only=True)
class Ports:
    """The names of the signals that the live model reads, and how many samples of them it needs
    before the first step (`back`) and after the last one (`ahead`).
    """

    back: int
    ahead: int
    signals: frozenset[str]


def records(
    program: Program,
    data: Dataset,
    runs: Sequence[Simulation],
    ports: Ports,
    linear: frozenset[str] = frozenset(),
) -> Records:
    """The runs as the page draws them, test set first, as many as fit into about 3 MB; the first
    ones with all samples, later ones thinned.

    `program` is in window form; a predicted input is fed back and not drawn as input. `ports` are
    the signals of the live model, which are stored too. Inputs are drawn as held between samples,
    except for those in `linear`.
    """
    ordered = shown_first(runs)
    outputs = output_channels(program)
    signals = _signals(program, data, ports.signals)
    drawn = [channel.name for channel in channels(_open(program))]
    lines = 3 * len(outputs) + len(signals)  # of what is thinned measured and error too
    exact, rest = _EXACT, _REST
    shown: list[Plain] = []
    for run in ordered[:_MOST_RECORDS]:
        # measured values are signals that are kept anyway; errors are computed by the page
        many = run.steps * (len(outputs) + len(signals))
        if many <= exact:
            block, exact = 1, exact - many
        # the first record, which is looked at first, gets all the room where that shows anything
        elif not shown and many <= 20 * _EXACT:
            block, exact = int(np.ceil(2 * run.steps * lines / exact)), 0
        else:
            points = min(_POINTS, rest // max(lines, 1))
            # fewer would be a picture of the thinning
            if points < _FEWEST:
                break
            # two points a block
            block, rest = max(int(np.ceil(2 * run.steps / points)), 1), rest - points * lines
        shown.append(_record(run, data, outputs, signals, drawn, ports, block, linear))
    left_out = _left_out(len(runs) - len(shown), program)
    return Records(shown, left_out)


def _left_out(records: int, program: Program) -> list[str]:
    said = [f"{records} more records are not drawn: the page would grow beyond 3 MB"]
    found = said if records else []
    outputs = sum(program.step[output.node].type.size for output in program.outputs)
    inputs = sum(Type(signal.axes).size for signal in _open(program))
    for kind, every, drawn in (
        ("outputs", outputs, len(output_channels(program))),
        ("inputs", inputs, len(channels(_open(program)))),
    ):
        if every > drawn:
            found.append(f"{every - drawn} of {every} numbers of the {kind} are not drawn")
    return found


def _open(program: Program) -> list[Signal]:
    """The inputs that a simulation reads from the recording: all that no output predicts."""
    predicted = {o.predicts.signal for o in program.outputs if o.predicts is not None}
    return [s for s in program.signals if s.role is Role.INPUT and s.name not in predicted]


def _signals(program: Program, data: Dataset, ports: frozenset[str]) -> list[DrawnNumber]:
    """The elements of the recorded signals that the page stores: inputs, predicted targets, and
    targets that the live model reads (`ports`).
    """
    predicted = {o.predicts.signal for o in program.outputs if o.predicts is not None}
    wanted = [s for s in program.signals if s.name in data.series]
    wanted = [s for s in wanted if s.role is Role.INPUT or s.name in predicted | ports]
    return channels(wanted)


def _record(
    run: Simulation,
    data: Dataset,
    outputs: Sequence[DrawnNumber],
    signals: Sequence[DrawnNumber],
    drawn: Sequence[str],
    ports: Ports,
    block: int,
    linear: frozenset[str],
) -> Plain:
    # rows of the whole data, in which `series` has all records one behind the other
    t0 = run.record.start + run.first
    # within the record: rows before it are those of another one
    begin = max(run.record.start, t0 - ports.back)
    end = min(run.record.stop, t0 + run.steps + ports.ahead)
    rows = slice(begin, end)
    kept = {
        channel.name: {**series(channel.of(data.series[channel.source][rows]), block)}
        for channel in signals
    }
    for found in kept.values():
        # where the first kept sample is, counted from the first step
        found["at"] = begin - t0
    sets = [name or "no set" for name in dict.fromkeys(run.places.sets)]
    told = f"{run.record.file} · {', '.join(sets)}" if sets else run.record.file
    note = (
        f"Drawn by the lowest and highest of {block} neighbours: zooming in shows no more."
        if block > 2
        else ""
    )
    return {
        "name": told,
        "steps": run.steps,
        "whole": block <= 2,
        "timed": run.places.time is not None,
        "x": _places(run),
        "note": note,
        "signals": kept,
        "starts": {
            element_name(name, index): finite(float(value[index]))
            for name, value in run.starts.items()
            for index in np.ndindex(value.shape)
        },
        "outputs": [_output(run, data, channel, block, t0) for channel in outputs],
        "inputs": [
            {
                "signal": channel.name,
                "unit": channel.unit,
                "low": finite(channel.low),
                "high": finite(channel.high),
                # neighbours of which the lowest and highest are kept are no samples that stand
                "held": block <= 2 and channel.source not in linear,
            }
            for channel in signals
            if channel.name in drawn
        ],
    }


def _places(run: Simulation) -> Plain:
    """The x-axis of a run as JSON: times in seconds, or row numbers if the recording has no times.
    Start and step if they are evenly spaced within a hundredth of a step, else all values.
    """
    along = run.places.along(timed=True)
    if len(along) < 2:
        return {"start": float(along[0]), "step": 1.0}
    step = float(along[-1] - along[0]) / (len(along) - 1)
    even = along[0] + step * np.arange(len(along))
    # a hundredth of a step is less than a line is wide; logs round their times
    if step > 0 and np.abs(even - along).max() < 0.01 * step:
        return {"start": float(along[0]), "step": step}
    return packed(along)


def _output(
    run: Simulation, data: Dataset, channel: DrawnNumber, block: int, t0: int
) -> dict[str, Any]:
    simulated = channel.of(run.outputs[channel.source])
    found: dict[str, Any] = {
        "name": channel.name,
        "unit": channel.unit,
        "error_unit": channel.error_unit,
        "low": finite(channel.low),
        "high": finite(channel.high),
        "simulated": series(simulated, block),
        "measured": None,
        "fit": None,
        "rmse": None,
    }
    if channel.source not in run.logged:
        return found
    measured = channel.of(run.logged[channel.source])
    errors = Errors.of(simulated, measured)
    found["fit"] = finite(score("fit", errors).value)
    found["rmse"] = finite(score("rmse", errors).value)
    found["measured"] = _measured(run, data, channel, measured, block, t0)
    # the page takes the difference itself where what it has been given is exact enough for that
    coarse = max(rounding(simulated), rounding(measured)) > _SHARE * score("rmse", errors).value
    if block > 2 or coarse:
        found["error"] = series(simulated - measured, block)
    return found


def _measured(
    run: Simulation, data: Dataset, channel: DrawnNumber, measured: FloatArray, block: int, t0: int
) -> Plain:
    """The measurements of the output `channel` as JSON. If a stored signal has the same values
    `ahead` samples later, only its name and `ahead`; else `measured`, thinned in blocks of `block`.

    `t0` is the row of the first step in `data`.
    """
    assert channel.predicts is not None
    name, ahead = channel.predicts
    series_of = channel.of(data.series[channel.predicted_source])
    # the predicted signal `ahead` samples later; the last steps of a record predict beyond its end
    there = series_of[t0 + ahead : min(t0 + ahead + run.steps, run.record.stop)]
    kept, rest = measured[: len(there)], measured[len(there) :]
    if block <= 2 and np.array_equal(there, kept, equal_nan=True) and np.isnan(rest).all():
        return {"signal": name, "ahead": ahead}
    return series(measured, block)
