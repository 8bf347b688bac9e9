"""Computes the learning rate of each epoch, as a factor of the optimiser's own, and checks it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import assert_never

import numpy as np

from msnn.errors.learning.stages import rate_beyond
from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.diagnostics.source import Span
from spec_schema.late_dataclass import dataclass
from spec_schema.sections.training.schedules import Cosine, Exponential, Plateau, Step

Rule = Cosine | Exponential | Step | Plateau | None


@dataclass(frozen=True, slots=True)
class Reductions:
    """The number of a plateau's reductions, and the epoch after which the last one came."""

    count: int = 0
    epoch: int = 0


NO_REDUCTIONS = Reductions()


def rate_factor(rule: Rule, epoch: int, epochs: int, reductions: Reductions) -> float:
    """The factor of the rate in the epoch after `epoch` complete ones of `epochs`.

    cosine to e: e + (1 − e)(1 + cos(π · epoch / epochs)) / 2; the others are powers.
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
    """The project's own function: that of the system has other bits elsewhere."""
    # `check` plans stages too, and asks for no rate
    from compiler.kernels.evaluate import evaluate

    return float(evaluate(name, *(np.asarray(value, np.float64) for value in arguments)))


def after_epoch(rule: Rule, epoch: int, better: int, reductions: Reductions) -> Reductions:
    """The reductions after `epoch` complete ones, the last better monitor after `better`."""
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
    """Refuses a rate that is infinite in what the stage computes with."""
    largest = max((rate or 0.0) * factor for factor in (1.0, *factors.values()))
    most = float(np.finfo(dtype).max)
    if largest > most:
        findings.report(rate_beyond(stage, largest, dtype, most, place))
