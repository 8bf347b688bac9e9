"""Checks penalties and priors of a stage: which can its optimiser handle?"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from compiler.ir.program import Parameter, Program
from msnn.errors.learning import knowledge
from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.diagnostics.source import Span
from spec_schema.sections.optimizers import OptimizerChoice


def with_reached_corners(
    program: Program,
    optimizer: OptimizerChoice,
    weights: Mapping[str, float],
    stage: str,
    findings: Findings,
) -> Program:
    """The program with only those penalties that this optimiser can minimise exactly.

    The others become ordinary losses with gradients: those with a negative weight, and, with a
    warning, all of a purely gradient-based optimiser.
    """
    left = [loss for loss in program.losses if loss.penalty is not None and weights[loss.name]]
    if left and not optimizer.reaches_corners:
        for loss in left:
            findings.report(knowledge.no_corner(loss.name, optimizer.noun, stage, loss.span))
    losses = [
        loss
        if optimizer.reaches_corners and weights[loss.name] >= 0
        else replace(loss, penalty=None)
        for loss in program.losses
    ]
    return replace(program, losses=tuple(losses))


def without_corners(program: Program) -> Program:
    """The program with all penalties as ordinary losses."""
    losses = [replace(loss, penalty=None) for loss in program.losses]
    return replace(program, losses=tuple(losses))


def check_priors(
    program: Program,
    trained: Sequence[Parameter],
    weights: Mapping[str, float],
    stage: str,
    span: Span | None,
    findings: Findings,
) -> None:
    """Reports priors if no loss has a measured target, because priors then have no scale."""
    measured = any(weights[loss.name] and loss.target is not None for loss in program.losses)
    known = [parameter.name for parameter in trained if parameter.prior is not None]
    if known and not measured:
        findings.report(knowledge.nothing_beside_priors(known, stage, span))
