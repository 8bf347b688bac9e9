"""Reports what the data show of columns, of the system and of the model, with repairs."""

from __future__ import annotations

import math
from collections.abc import Container, Iterator, Sequence

import numpy as np

from compiler.ir.program import Output, Role
from msnn.data.reading.rows import GAP_TOLERANCE
from msnn.data.rollout_rows import reads
from msnn.errors.data.rows import other_sample_time, step_repair
from msnn.features.data_check import errors
from msnn.features.data_check.channels import RowsOfData
from msnn.features.data_check.dynamics.check import JointTest
from msnn.features.data_check.dynamics.excitation import Excitation
from msnn.features.data_check.dynamics.impulse_response import ROWS_OF_A_PIECE, TimeConstants
from msnn.features.data_check.errors import too_few_rows
from msnn.features.data_check.found import (
    CheckedChannel,
    CheckedSystem,
    CheckedTarget,
    DatasetCheck,
)
from msnn.features.data_check.signals import FEW_LEVELS, doubt
from msnn.model.model import Model
from msnn.training.plans.stage_plan import plan_stages
from spec_schema.diagnostics.diagnostic import Diagnostic, Findings

_COARSE = 0.01
"""Rounding error relative to the standard deviation that visibly reduces `fit`."""
_SWITCHED = 2
"""A target with so few values is a state such as on and off, not a rounded measurement."""
_LITTLE = 0.1
"""Fraction of a declared range; data that cover less contain little about the range."""


def sampling_findings(
    model: Model, checked: DatasetCheck, *, resampled: bool
) -> Iterator[Diagnostic]:
    """Reports uneven sampling of every file, and sample times that differ from the spec."""
    expected = model.program.sample_time
    for found in checked.sampling:
        if found.repeated or found.backward:
            wrong = found.backward or found.repeated
            # backward rows are the worse fault: they are told first
            yield errors.repeated_times(
                file=found.file, count=len(wrong), row=wrong[0], backward=bool(found.backward)
            )
        if expected is None or not np.isfinite(found.step):
            continue
        if abs(found.step - expected) > GAP_TOLERANCE * expected and not resampled:
            time = found.time_unit
            repair = step_repair(
                found.step,
                expected,
                rows=found.rows * found.every,
                every=found.every,
                column=None if time is None else time.column,
                unit=None if time is None else time.unit,
            )
            yield other_sample_time(
                file=found.file, found=found.step, expected=expected, repair=repair
            )
        if found.gaps:
            yield errors.gaps_in_time(
                file=found.file,
                count=len(found.gaps),
                longest=found.longest,
                row=found.longest_row,
            )
        # uneven steps are what resampling is for
        if found.worst > GAP_TOLERANCE and not resampled:
            yield errors.uneven_steps(
                file=found.file,
                step=found.step,
                jitter=found.jitter,
                worst=found.worst,
                row=found.worst_row,
            )


def signal_findings(
    checked: DatasetCheck, ended: str | None, targets: Container[str]
) -> Iterator[Diagnostic]:
    """Reports faults in the values of every column.

    `ended` is the key of the spec that ends episodes at missing inputs, or leaves records out.
    `targets` are the names of the signals that are predicted.
    """
    for one in checked.channels:
        # a column without any value is told once, not by each check
        if one.found.missing == one.found.rows:
            if one.found.rows:
                yield errors.constant_signal(
                    signal=one.channel.name, value=None, unit="", where=_files(checked.rows)
                )
            continue
        yield from _values(one, checked.rows, ended, one.channel.signal.name in targets)
        yield from _constant(one, checked.rows)


def _values(
    one: CheckedChannel, rows: RowsOfData, ended: str | None, is_target: bool
) -> Iterator[Diagnostic]:
    channel, found = one.channel, one.found
    name, unit, signal = channel.name, channel.unit, channel.signal
    if found.missing:
        yield errors.missing_values(
            signal=name,
            count=found.missing,
            rows=found.rows,
            place=rows.place(found.first_missing),
            longest=found.longest_missing,
            is_input=signal.role is Role.INPUT,
            ended=ended,
        )
    if len(found.spikes):
        highest = int(np.argmax(found.spikes.heights))
        yield errors.spikes_found(
            signal=name,
            count=len(found.spikes),
            height=float(found.spikes.heights[highest]),
            unit=channel.difference_unit,
            place=rows.place(int(found.spikes.rows[highest])),
        )
    for limit in found.saturations:
        yield errors.stays_at_limit(
            signal=name,
            side=limit.side,
            value=limit.value,
            unit=unit,
            rows=limit.rows,
            longest=limit.longest,
            place=rows.place(limit.first),
        )
    grid = found.quantisation
    # an input of few levels is switched between them; a target of few is rounded most coarsely
    least = _SWITCHED if is_target else FEW_LEVELS
    if grid is not None and grid.levels > least and grid.share > _COARSE:
        yield errors.coarse_steps(
            signal=name,
            step=grid.step,
            unit=channel.difference_unit,
            levels=grid.levels,
            bits=grid.bits,
            share=grid.share,
            may_switch=grid.levels <= FEW_LEVELS,
        )
    if (found_doubt := doubt(signal.unit, found.low, found.high)) is not None:
        rather, reason = found_doubt
        yield errors.doubtful_unit(
            signal=name,
            unit=unit.strip(),
            low=found.low,
            high=found.high,
            rather=rather,
            reason=reason,
        )
    if signal.range is not None and found.low < found.high:
        least, most = signal.range
        # how much of the declared range was seen; below 0 it lies outside, which reading has said
        share = (min(found.high, most) - max(found.low, least)) / (most - least)
        if 0 <= share < _LITTLE:
            yield errors.little_of_range(
                signal=name,
                low=found.low,
                high=found.high,
                least=least,
                most=most,
                unit=unit,
                share=share,
            )


def _constant(one: CheckedChannel, rows: RowsOfData) -> Iterator[Diagnostic]:
    """Reports a constant series, in all recordings or in some of several."""
    values = one.channel.values
    still: list[tuple[str, float]] = []
    # a signal may stand still in one record of several
    for record in rows.records:
        part = values[record.start : record.stop]
        known = part[np.isfinite(part)]
        if len(known) > 1 and np.ptp(known) == 0:
            still.append((record.file, float(known[0])))
    if not still:
        return
    where = still[0][0]
    if len(still) > 1:
        where += f" and {len(still) - 1} more"
    yield errors.constant_signal(
        signal=one.channel.name, value=still[0][1], unit=one.channel.unit, where=where
    )


def _files(rows: RowsOfData) -> str:
    files = [record.file for record in rows.records]
    return files[0] if len(files) == 1 else f"{files[0]} and {len(files) - 1} more"


def dynamics_findings(system: CheckedSystem, *, resampled: bool) -> Iterator[Diagnostic]:
    """Reports inputs with weak excitation, and targets without a visible response."""
    for dependence in system.about.dependences:
        terms = [
            f"{factor:.4g} {system.inputs[other].name}" for other, factor in dependence.factors
        ]
        yield errors.dependent_inputs(
            input=system.inputs[dependence.number].name,
            formula=" + ".join(terms).replace("+ -", "- "),
            share=dependence.share,
        )
    for channel, found in zip(system.inputs, system.about.excitation, strict=True):
        # an input without excitation stands still, which is said of the column
        if found is not None and found.weak:
            yield errors.weak_excitation(
                input=channel.name,
                order=found.order,
                needed=found.tested,
                highest=highest_frequency(found, system.step),
            )
    for target in system.targets:
        yield from _target(system, target, resampled=resampled)


def highest_frequency(found: Excitation, step: float) -> float:
    """Upper end in Hz of the band that contains 99 % of the power."""
    return found.highest / step


def _target(
    system: CheckedSystem, target: CheckedTarget, *, resampled: bool
) -> Iterator[Diagnostic]:
    found, name = target.found, target.channel.name
    # of an input that stands still nothing can be answered
    moving = [i for i, excites in enumerate(system.about.excitation) if excites is not None]
    if not moving or not target.moves:
        return
    if found.responses is None:
        needed = _needed(len(system.inputs))
        # too little for a long model, from which everything else follows
        yield too_few_rows(
            rows=found.rows,
            longest=found.longest,
            needed=needed,
            of=name,
            resampled=resampled,
        )
        return
    for number, share in enumerate(found.feedback):
        if share is not None:
            yield errors.closed_loop_data(
                input=system.inputs[number].name, signal=name, share=share
            )
    for role in found.set_points:
        yield errors.set_point_as_input(
            signal=name,
            input=system.inputs[role.number].name,
            controller=None if role.controller is None else system.inputs[role.controller].name,
        )
    yield from _no_response(system, target, moving)


def _no_response(
    system: CheckedSystem, target: CheckedTarget, moving: Sequence[int]
) -> Iterator[Diagnostic]:
    """Reports inputs without a visible response, of which the data could show one."""
    # what inputs that depend on each other do cannot be told apart
    together = {
        number
        for one in system.about.dependences
        for number in (one.number, *(other for other, _ in one.factors))
    }
    unseen: list[tuple[int, JointTest]] = []
    for number in moving:
        answer = target.found.answers[number]
        told = _told(system, number) and number not in together
        if answer is not None and told and not answer.seen:
            unseen.append((number, answer))
    for limited in (False, True):
        alike = [
            (number, answer)
            for number, answer in unseen
            if (answer.limited or _is_slow(system, number)) == limited
        ]
        if alike:
            yield errors.no_response(
                signal=target.channel.name,
                inputs=[system.inputs[number].name for number, _ in alike],
                lags=max(answer.lags for _, answer in alike),
                p_values=[answer.p_value for _, answer in alike],
                static=max(answer.static for _, answer in alike),
                limited=limited,
                elsewhere=any(_seen_elsewhere(system, target, number) for number, _ in alike),
            )


_COVERED = 0.25


def _is_slow(system: CheckedSystem, number: int) -> bool:
    """True if an input moves in few frequency bands alone, so that its effect may hide in drift."""
    excites = system.about.excitation[number]
    return excites is None or excites.covered < _COVERED


def _seen_elsewhere(system: CheckedSystem, target: CheckedTarget, number: int) -> bool:
    """True if another target needs this input."""
    others = (one.found.answers[number] for one in system.targets if one is not target)
    return any(answer is None or answer.seen for answer in others)


def _told(system: CheckedSystem, number: int) -> bool:
    """True if the excitation suffices to conclude that there is no response."""
    excites = system.about.excitation[number]
    return excites is not None and not excites.weak


def _needed(inputs: int) -> int:
    return ROWS_OF_A_PIECE * max(inputs, 1)


_FEWEST, _USUAL, _MOST = 5.0, 20.0, 60.0
"""Samples per time constant: 10 to 30 are usual (Åström and Wittenmark, Computer-Controlled
Systems, 1997, §3.9).

Values below half of the lower or above twice the upper limit are reported. Of an oscillation the
same numbers count per period, since ω₀h = 0.2 … 0.6 is usual there.
"""


def reading_findings(model: Model, system: CheckedSystem) -> Iterator[Diagnostic]:
    """Reports delays, sample times and windows of the spec that do not fit the data."""
    for target in system.targets:
        constants = target.found.constants
        if constants is not None and not constants.integrates:
            yield from _sampling(system, target, constants)
    expected = model.program.sample_time
    if expected is None or abs(system.step - expected) > GAP_TOLERANCE * expected:
        return  # rows of the files are no samples of the model
    for target in system.targets:
        for output in model.program.outputs:
            predicts = output.predicts
            if predicts is not None and predicts.signal == target.channel.signal.name:
                yield from _delays(model, system, target, output)
                yield from _window(model, system, target, output)
    yield from _horizon(model, system.targets)


def _sampling(
    system: CheckedSystem, target: CheckedTarget, constants: TimeConstants
) -> Iterator[Diagnostic]:
    # the slowest motion decides whether too slow, the fastest whether too fast
    scales = [
        (period, True) if math.isfinite(period) else (mode, False)
        for mode, period in zip(constants.modes, constants.periods, strict=True)
    ]
    slow, oscillates = max(scales)
    every = round(constants.fastest / _USUAL) if constants.fastest > _MOST else None
    if every is not None:
        slow, oscillates = min(scales)
        if _moves_within(system, target, every):
            return  # fewer rows would lose the motion of an input
    elif slow >= _FEWEST or constants.interval[1] > 2 * constants.slowest:
        return
    rows, kind = slow, "period" if oscillates else "time constant"
    yield errors.sampling_of_system(
        signal=target.channel.name,
        motion=f"has a {kind} of {rows * system.step:.3g} s",
        rows=rows,
        of=kind,
        every=every,
    )


_HELD = 0.05
"""Maximum variance, relative to that of an input, of its motion after a row that is used."""


def _moves_within(system: CheckedSystem, target: CheckedTarget, every: int) -> bool:
    """True if an input that the target responds to moves between rows 0, `every`, 2·`every`, …"""
    for number, channel in enumerate(system.inputs):
        answer = target.found.answers[number]
        if target.found.delays[number] is None and (answer is None or not answer.seen):
            continue
        values = channel.values
        lost = values - np.repeat(values[::every], every)[: len(values)]
        known = np.isfinite(lost)
        if known.any() and np.mean(lost[known] ** 2) > _HELD * np.var(values[known]):
            return True
    return False


def _delays(
    model: Model, system: CheckedSystem, target: CheckedTarget, output: Output
) -> Iterator[Diagnostic]:
    assert output.predicts is not None
    read = reads(model.program.step, [output.node])
    for number, channel in enumerate(system.inputs):
        delay, extent = target.found.delays[number], read.get(channel.signal.name)
        if delay is None or extent is None or not target.found.sharp[number]:
            continue
        ahead = output.predicts.ahead
        newest = ahead - delay
        # later than t + ahead − delay nothing is answered yet; t is the latest that is known
        # of what lies in the future only t is known: an output that reads t then reads the latest
        # there is
        if (newest < 0 and extent.last > newest) or (newest > 0 and extent.last < newest):
            yield errors.delayed_response(
                signal=target.channel.name,
                input=channel.name,
                delay=delay,
                seconds=f" ({delay * system.step:.4g} s)" if delay else "",
                ahead=ahead,
            )


def _window(
    model: Model, system: CheckedSystem, target: CheckedTarget, output: Output
) -> Iterator[Diagnostic]:
    """Advises on the window of an output without memory: it must cover the response."""
    found = target.found.responses
    read = reads(model.program.step, [output.node])
    # what remembers, or reads its own past, needs no window that long
    if found is None or model.program.states or target.channel.signal.name in read:
        return
    for number, channel in enumerate(system.inputs):
        extent = read.get(channel.signal.name)
        settled = found.settled(number)
        if extent is None or target.found.delays[number] is None:
            continue
        constants = target.found.constants
        rows = settled if settled is not None else constants.settling if constants else None
        window = extent.last - extent.first + 1
        # what is predicted k ahead sees k rows of the response that its window lacks
        if rows is not None and window < rows - (output.predicts.ahead if output.predicts else 0):
            yield errors.short_window(
                output=output.name,
                input=channel.name,
                window=window,
                settling=rows,
                keys=_windows(model),
            )


def _windows(model: Model) -> list[str]:
    """The keys of filter windows in the spec."""
    return [
        f"layers.{name}.fir.window"
        for name, layer in model.spec.layers.items()
        if layer.fir is not None and layer.fir.window is not None
    ]


def _horizon(model: Model, targets: Sequence[CheckedTarget]) -> Iterator[Diagnostic]:
    """Advises on rollouts of models with feedback: they must cover the slowest motion."""
    inputs = {s.name for s in model.program.signals if s.role is Role.INPUT}
    # the lower bound: what is said of the horizon holds although the estimate is not exact
    moving = [
        (constants.interval[0], constants.slowest, target.channel.name)
        for target in targets
        if (constants := target.found.constants) is not None
        and (target.channel.signal.name in inputs or model.program.states)
        and not constants.integrates
    ]
    longest: tuple[int, int] | None = None
    for plan in plan_stages(model.program, model.spec.train, Findings()):
        # a rollout over an episode lasts as long as there are data
        if isinstance(plan.rollout.horizon, str):
            return
        # of equal horizons the last stage: it decides the weights
        if longest is None or plan.rollout.horizon >= longest[0]:
            longest = plan.rollout.horizon, plan.index
    least, slowest, name = max(moving, default=(0.0, 0.0, ""))
    if longest is not None and longest[0] < math.floor(least):
        yield errors.short_horizon(
            signal=name,
            horizon=longest[0],
            constant=slowest,
            least=least,
            key=f"train.{longest[1]}.rollout.horizon",
        )
