"""Formats a data check as tables, and as JSON values."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from msnn.features.data_check.channels import RowsOfData
from msnn.features.data_check.dynamics.check import TargetCheck
from msnn.features.data_check.dynamics.impulse_response import TimeConstants
from msnn.features.data_check.dynamics.influence import SIGNIFICANCE
from msnn.features.data_check.found import (
    CheckedChannel,
    CheckedSystem,
    CheckedTarget,
    DataCheck,
    DatasetCheck,
)
from msnn.features.data_check.sampling import StepsOfTime
from msnn.tables import table_text
from msnn.validation.reports.words import difference_text
from spec_schema.diagnostics.render import records

_MOST_FILES = 20
_MOST_PLACES = 1000


def check_tables(check: DataCheck) -> str:
    """Tables of the files, the columns, the inputs and the responses."""
    parts: list[str] = []
    for dataset in check.datasets:
        files = _files_table(dataset.sampling)
        parts += [text for text in (files, _channels_table(dataset)) if text]
    if check.system is not None:
        parts += [
            text for text in (_inputs_table(check.system), _pairs_table(check.system)) if text
        ]
    return "\n\n".join(parts)


def check_record(check: DataCheck) -> dict[str, Any]:
    """The results as JSON values; unknown numbers are None or NaN."""
    return {
        "sample_time": check.sample_time,
        "datasets": [_dataset_record(dataset) for dataset in check.datasets],
        "system": None if check.system is None else _system_record(check.system),
        "findings": records(check.findings),
    }


def _files_table(sampling: Sequence[StepsOfTime]) -> str:
    if not sampling:
        return ""
    header = ("file", "rows", "step / s", "jitter", "gaps", "lost rows", "repeated", "backward")
    rows = [
        (
            one.file,
            str(one.rows),
            _number(one.step),
            f"{one.jitter:.1%}",
            _count(len(one.gaps)),
            _count(one.lost),
            _count(len(one.repeated)),
            _count(len(one.backward)),
        )
        for one in sampling[:_MOST_FILES]
    ]
    if len(sampling) > _MOST_FILES:
        rows.append((f"… and {len(sampling) - _MOST_FILES} more files", "", "", "", "", "", "", ""))
    return table_text(header, rows, numbers=range(1, 8))


def _channels_table(dataset: DatasetCheck) -> str:
    header = (
        *(f"column of {dataset.name}", "unit", "values", "missing", "mean", "deviation"),
        *("lowest", "highest", "spikes", "at a limit", "bit"),
    )
    return table_text(header, [_channel_row(one) for one in dataset.channels], numbers=range(2, 11))


def _channel_row(one: CheckedChannel) -> tuple[str, ...]:
    found, unit = one.found, one.channel.signal.unit
    return (
        one.channel.name,
        "" if unit is None else unit.text,
        str(found.rows - found.missing),
        _count(found.missing),
        _number(found.mean),
        difference_text(_number(found.deviation), unit),
        _number(found.low),
        _number(found.high),
        _count(len(found.spikes)),
        _count(sum(limit.rows for limit in found.saturations)),
        "" if found.quantisation is None else f"{found.quantisation.bits:.1f}",
    )


def _inputs_table(system: CheckedSystem) -> str:
    header = ("input", "99 % of its power / Hz", "of the bands to Nyquist", "excites")
    rows: list[tuple[str, ...]] = []
    for channel, found in zip(system.inputs, system.about.excitation, strict=True):
        if found is not None:
            band = f"{found.lowest / system.step:.3g} … {found.highest / system.step:.3g}"
            least = "" if found.weak else "≥ "
            rows.append((channel.name, band, f"{found.covered:.0%}", f"{least}{found.order}"))
    return table_text(header, rows, numbers=(1, 2, 3)) if rows else ""


def _pairs_table(system: CheckedSystem) -> str:
    header = ("target", "input", "response", "delay", "delay / s", "time constants / s")
    header += ("slowest, range / s", "periods / s", "settled after / s", "predicted by target")
    rows: list[tuple[str, ...]] = []
    for target in system.targets:
        for number, channel in enumerate(system.inputs):
            rows.append(_pair_row(system, target, number, channel.name))
    return table_text(header, rows, numbers=range(3, 10)) if rows else ""


def _pair_row(
    system: CheckedSystem, target: CheckedTarget, number: int, name: str
) -> tuple[str, ...]:
    found, step = target.found, system.step
    delay, constants, share = found.delays[number], found.constants, found.feedback[number]
    # a response that rises slowly may have begun earlier
    least = "" if found.sharp[number] or not delay else "≤ "
    # a time constant without a visible response belongs to other inputs
    answer = found.answers[number]
    seen = constants is not None and (delay is not None or (answer is not None and answer.seen))
    settling = constants.settling if seen and constants else None
    periods = [p for p in constants.periods if math.isfinite(p)] if seen and constants else []
    return (
        target.channel.name,
        name,
        _response_text(target, number),
        "" if delay is None else f"{least}{delay}",
        "" if delay is None else f"{least}{_number(delay * step)}",
        ", ".join(_number(mode * step) for mode in dict.fromkeys(constants.modes))
        if seen and constants
        else "",
        _range_text(constants, step) if seen and constants else "",
        ", ".join(_number(period * step) for period in dict.fromkeys(periods)),
        "" if settling is None else _number(settling * step),
        "" if share is None else f"{share:.0%}",
    )


def _response_text(target: CheckedTarget, number: int) -> str:
    """The table's text for a response of the target to an input: p-value, or why there is none."""
    role, answer = target.found.set_point(number), target.found.answers[number]
    if role is not None:
        return "set-point"
    if answer is None:
        return "not tested"
    chance = "p < 1e-99" if answer.p_value < 1e-99 else f"p = {answer.p_value:.2g}"
    if answer.p_value < SIGNIFICANCE:
        return chance
    if answer.in_row:
        return "in the same row"
    return f"unclear, {chance}" if answer.alone or answer.limited else f"none seen, {chance}"


def _range_text(constants: TimeConstants, step: float) -> str:
    """The uncertainty of the slowest time constant."""
    if constants.growing:
        return "unstable"
    if not constants.has_range:
        return "not known"
    low = _number(constants.interval[0] * step)
    if constants.integrates:
        return f"≥ {low}, or an integrator"
    return f"{low} … {_number(constants.interval[1] * step)}"


def _dataset_record(dataset: DatasetCheck) -> dict[str, Any]:
    return {
        "name": dataset.name,
        "files": [
            {
                "file": one.file,
                "rows": one.rows,
                "step": one.step,
                "mean": one.mean,
                "jitter": one.jitter,
                "lost": one.lost,
                "gaps": list(one.gaps[:_MOST_PLACES]),
                "repeated": list(one.repeated[:_MOST_PLACES]),
                "backward": list(one.backward[:_MOST_PLACES]),
            }
            for one in dataset.sampling
        ],
        "columns": [_channel_record(one, dataset.rows) for one in dataset.channels],
    }


def _channel_record(one: CheckedChannel, rows: RowsOfData) -> dict[str, Any]:
    found, unit = one.found, one.channel.signal.unit
    grid = found.quantisation
    return {
        "name": one.channel.name,
        "unit": None if unit is None else unit.text,
        # of `deviation`, `step` and heights of spikes: K in a column in degC
        "difference_unit": None if unit is None else unit.difference.text,
        "rows": found.rows,
        "missing": found.missing,
        "mean": found.mean,
        "deviation": found.deviation,
        "low": found.low,
        "high": found.high,
        "spikes": [
            {"place": rows.place(row), "height": height}
            for row, height in zip(
                found.spikes.rows.tolist()[:_MOST_PLACES],
                found.spikes.heights.tolist(),
                strict=False,
            )
        ],
        "limits": [
            {
                "side": limit.side,
                "value": limit.value,
                "rows": limit.rows,
                "longest": limit.longest,
                "place": rows.place(limit.first),
            }
            for limit in found.saturations
        ],
        "step": None if grid is None else grid.step,
        "levels": None if grid is None else grid.levels,
        "bits": None if grid is None else grid.bits,
    }


def _system_record(system: CheckedSystem) -> dict[str, Any]:
    inputs = [
        {
            "name": channel.name,
            "order": None if found is None else found.order,
            "lowest": None if found is None else found.lowest / system.step,
            "highest": None if found is None else found.highest / system.step,
            "covered": None if found is None else found.covered,
        }
        for channel, found in zip(system.inputs, system.about.excitation, strict=True)
    ]
    return {
        "step": system.step,
        "inputs": inputs,
        "targets": [_target_record(system, target) for target in system.targets],
    }


def _target_record(system: CheckedSystem, target: CheckedTarget) -> dict[str, Any]:
    found, step = target.found, system.step
    constants = found.constants
    return {
        "name": target.channel.name,
        "rows": found.rows,
        "time_constants": [] if constants is None else [mode * step for mode in constants.modes],
        "periods": [] if constants is None else [period * step for period in constants.periods],
        "damping": [] if constants is None else list(constants.damping),
        "slowest": None
        if constants is None
        else {
            "value": constants.slowest * step,
            "low": constants.interval[0] * step if constants.has_range else None,
            "high": constants.interval[1] * step if constants.has_range else None,
            "unstable": constants.growing,
        },
        "settling": None
        if constants is None or constants.settling is None
        else constants.settling * step,
        "inputs": [
            {
                "name": channel.name,
                "delay": found.delays[number],
                "sharp": found.sharp[number],
                "feedback": found.feedback[number],
                **_answer_record(system, found, number),
                "response": _list(found.responses and found.responses.values[number]),
                "error": _list(found.responses and found.responses.errors[number]),
            }
            for number, channel in enumerate(system.inputs)
        ],
    }


def _answer_record(system: CheckedSystem, found: TargetCheck, number: int) -> dict[str, Any]:
    role, answer = found.set_point(number), found.answers[number]
    acting = None if role is None else role.controller
    return {
        "set_point": role is not None,
        "controller": None if acting is None else system.inputs[acting].name,
        "p_value": None if answer is None else answer.p_value,
        "in_row": None if answer is None else answer.in_row,
        "static_limit": None if answer is None else answer.static,
    }


def _list(values: Any) -> list[float] | None:
    return None if values is None else values.tolist()


def _number(value: float) -> str:
    return f"{value:.4g}" if math.isfinite(value) else ("∞" if value == math.inf else "")


def _count(number: int) -> str:
    return str(number) if number else ""
