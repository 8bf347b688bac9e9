"""Computes the learning rate of each epoch, as a factor of the optimiser's rate, and checks it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import assert_never

import numpy as np

from msnn.errors.learning.stages import rate_beyond
from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.diagnostics.source import Span
from spec_schema.late_dataclass import dataclass
from spec_schema.sections.training import Cosine, Exponential, Plateau, Step

Rule = Cosine | Exponential | Step | Plateau | None


@dataclass(frozen=True, slots=True)
class Reductions:
    """Number of reductions on a plateau, and the epoch of the last one."""

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
    """The reductions after `epoch` epochs, if the monitor last improved after `better`."""
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
    """Reports a learning rate that overflows in the dtype of the stage."""
    largest = max((rate or 0.0) * factor for factor in (1.0, *factors.values()))
    most = float(np.finfo(dtype).max)
    if largest > most:
        findings.report(rate_beyond(stage, largest, dtype, most, place))
