"""Compares windows, sample time and training of a model with the data."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from compiler.ir.program import Output, Role
from msnn.data.reading.rows import GAP_TOLERANCE
from msnn.data.reads import reads
from msnn.features.data_check.dynamics.time_constants import TimeConstants
from msnn.features.data_check.errors import dynamics as errors
from msnn.features.data_check.found import CheckedSystem, CheckedTarget
from msnn.model.model import Model
from msnn.training.plans.stage_plan import plan_stages
from spec_schema.diagnostics.diagnostic import Diagnostic, Findings

_FEWEST, _USUAL, _MOST = 5.0, 20.0, 60.0
"""Samples per time constant: 10 to 30 are usual (Åström and Wittenmark, Computer-Controlled
Systems, 1997, §3.9).

Values below half of the lower or above twice the upper limit are reported.
"""


def reading_findings(model: Model, system: CheckedSystem) -> Iterator[Diagnostic]:
    """Reports delays, sample times and windows of the spec that do not fit the data."""
    for target in system.targets:
        constants = target.found.constants
        if constants is not None and math.isfinite(constants.slowest):
            yield from _sampling(target, constants, system.step)
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


def _sampling(target: CheckedTarget, constants: TimeConstants, step: float) -> Iterator[Diagnostic]:
    rows = constants.slowest
    # the slowest motion decides whether too slow, the fastest whether too fast
    if constants.slowest < _FEWEST or constants.fastest > _MOST:
        every = round(constants.fastest / _USUAL) if constants.fastest > _MOST else None
        yield errors.sampling_of_system(
            signal=target.channel.name, constant=rows * step, rows=rows, every=every
        )


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
    moving = [
        (target.found.constants.slowest, target.channel.name)
        for target in targets
        if target.found.constants is not None
        and (target.channel.signal.name in inputs or model.program.states)
        and math.isfinite(target.found.constants.slowest)
    ]
    longest: tuple[int, int] | None = None
    for plan in plan_stages(model.program, model.spec.train, Findings()):
        # a rollout over an episode lasts as long as there are data
        if isinstance(plan.rollout.horizon, str):
            return
        # of equal horizons the last stage: it decides the weights
        if longest is None or plan.rollout.horizon >= longest[0]:
            longest = plan.rollout.horizon, plan.index
    slowest, name = max(moving, default=(0.0, ""))
    if longest is not None and longest[0] < round(slowest):
        yield errors.short_horizon(
            signal=name,
            horizon=longest[0],
            constant=slowest,
            key=f"train.{longest[1]}.rollout.horizon",
        )
