"""Plans the epochs of a stage: horizons of a curriculum, learning rates, the order of rollouts."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import assert_never

import numpy as np

from compiler.ir.program import Program
from msnn.data.dataset import IntArray
from msnn.errors.learning import stages as errors
from msnn.errors.learning.stages import rate_beyond
from msnn.simulation.rollout_plan import RolloutPlan, samples
from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.diagnostics.source import Span
from spec_schema.late_dataclass import dataclass
from spec_schema.sections.training import Cosine, Exponential, Plateau, Rollout, Step


@dataclass(frozen=True, slots=True)
class Phase:
    """A phase of a curriculum: until the end of epoch `until`, rollouts have `horizon` steps."""

    until: int
    horizon: int


def plan_curriculum(
    program: Program, rollout: Rollout, plan: RolloutPlan, epochs: int, findings: Findings
) -> tuple[Phase, ...]:
    """The phases of a curriculum before the full horizon; empty without one.

    Errors go to `findings`.
    """
    if rollout.curriculum is None:
        return ()
    if plan.horizon == "record":
        problem = "`horizon: record` runs each record once, from its beginning to its end"
        findings.report(errors.misfitting_curriculum(problem, rollout.curriculum.span))
        return ()
    phases: list[Phase] = []
    for lesson in rollout.curriculum.lessons:
        horizon = samples(lesson.horizon, program.sample_time, findings)
        if horizon is None:
            continue
        problem = _problem(Phase(lesson.until, horizon), phases, plan, epochs)
        if problem is not None:
            findings.report(errors.misfitting_curriculum(problem, lesson.span))
        phases.append(Phase(lesson.until, horizon))
    return tuple(phases)


def _problem(phase: Phase, before: list[Phase], plan: RolloutPlan, epochs: int) -> str | None:
    if phase.until >= epochs:
        return f"epoch {phase.until} is not before the last one, {epochs}"
    if before and phase.until <= before[-1].until:
        return f"epoch {phase.until} does not come after epoch {before[-1].until}"
    if before and phase.horizon <= before[-1].horizon:
        return f"{phase.horizon} evaluations are not more than the {before[-1].horizon} before"
    if isinstance(plan.horizon, int) and phase.horizon >= plan.horizon:
        return f"{phase.horizon} evaluations are not fewer than the horizon, {plan.horizon}"
    if phase.horizon <= plan.skip:
        return f"{plan.skipped_by} {plan.skip} leaves nothing of {phase.horizon} evaluations"
    return None


Rule = Cosine | Exponential | Step | Plateau | None


@dataclass(frozen=True, slots=True)
class Reductions:
    """How often the schedule `plateau` has reduced the learning rate, and the epoch of the last
    time.
    """

    count: int = 0
    epoch: int = 0


NO_REDUCTIONS = Reductions()


def rate_factor(rule: Rule, epoch: int, epochs: int, reductions: Reductions) -> float:
    """The factor of the learning rate after `epoch` of `epochs` completed epochs.

    cosine to e: e + (1 − e)(1 + cos(π · epoch / epochs)) / 2; the other schedules are powers.
    """
    match rule:
        case None:
            return 1.0
        case Cosine(to=to):
            return to + (1 - to) * (1 + _kernel("cos", math.pi * epoch / epochs)) / 2
        case Exponential(factor=factor):
            return _kernel("pow", factor, epoch)
        case Step(every=every, factor=factor):
            return _kernel("pow", factor, epoch // every)
        case Plateau(factor=factor, min=least):
            return max(_kernel("pow", factor, reductions.count), least)
        case _:
            assert_never(rule)


def _kernel(name: str, *arguments: float) -> float:
    """Evaluates the project's own function, because results of the system's libm vary in their
    bits.
    """
    # `check` plans stages too, and asks for no rate
    from compiler.kernels.table import evaluate

    return float(evaluate(name, *(np.asarray(value, np.float64) for value in arguments)))


def after_epoch(rule: Rule, epoch: int, better: int, reductions: Reductions) -> Reductions:
    """The reductions of the learning rate after `epoch` epochs, if the monitor last improved in
    epoch `better`.

    Only the schedule `plateau` adds one, after `patience` epochs without improvement.
    """
    if isinstance(rule, Plateau) and epoch - max(better, reductions.epoch) >= rule.patience:
        return Reductions(reductions.count + 1, epoch)
    return reductions


def check_rate(
    stage: str,
    rate: float | None,
    factors: Mapping[str, float],
    dtype: str,
    place: Span | None,
    findings: Findings,
) -> None:
    """Reports a learning rate, times the largest factor of a parameter, that overflows in
    `dtype`.
    """
    largest = max((rate or 0.0) * factor for factor in (1.0, *factors.values()))
    most = float(np.finfo(dtype).max)
    if largest > most:
        findings.report(rate_beyond(stage, largest, dtype, most, place))


_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_FIRST, _SECOND = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)


def order_key(seed: int, stage: int, epoch: int, attempt: int = 0) -> int:
    """The 64-bit key that determines the order of one epoch."""
    source = np.random.SeedSequence([seed, stage, epoch, attempt])
    return int(source.generate_state(1, np.uint64)[0])


def shuffled(count: int, key: int) -> IntArray:
    """The integers 0 … count−1 in an order determined by a key, count < 2³².

    The inside-out form of the Fisher-Yates shuffle (Knuth, The Art of Computer Programming 2,
    algorithm P), with draws of SplitMix64 (Steele, Lea, Flood: Fast Splittable Pseudorandom Number
    Generators, OOPSLA 2014). Kernels do the same in C (templates/native/epochs.c).
    """
    order = list(range(count))
    for i, j in enumerate(_draws(count, key).tolist()):
        order[i] = order[j]
        order[j] = i
    return np.array(order, np.int64)


def _draws(count: int, key: int) -> IntArray:
    """For each i < count, a random integer in 0 … i."""
    numbers = np.arange(1, count + 1, dtype=np.uint64)
    bits = np.uint64(key) + numbers * _GOLDEN  # modulo 2⁶⁴, as all of it
    bits = (bits ^ (bits >> np.uint64(30))) * _FIRST
    bits = (bits ^ (bits >> np.uint64(27))) * _SECOND
    bits ^= bits >> np.uint64(31)
    return (((bits >> np.uint64(32)) * numbers) >> np.uint64(32)).astype(np.int64)
