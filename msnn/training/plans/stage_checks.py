"""Checks the losses, penalties and settings of a stage: can its optimiser handle them?"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from compiler.differentiation.sums_of_squares import is_sum_of_squares
from compiler.ir.nodes import needed, needed_over_time
from compiler.ir.ops import Apply, ReadParameter, ReadSamples, ReadState, Window
from compiler.ir.program import Graph, Measure, Parameter, Program
from msnn.errors.learning import stages
from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.diagnostics.source import Span
from spec_schema.sections.optimizers import OptimizerChoice
from spec_schema.sections.training import Stage


def concerns(program: Program, weights: Mapping[str, float], trained: Sequence[str]) -> bool:
    """True if a loss with a weight depends on a parameter in `trained`, at any step of a
    rollout.
    """
    counted = [loss for loss in program.losses if weights[loss.name]]
    wanted = [n for loss in counted for n in loss.nodes]
    following = {state.name: state.next for state in program.states}
    live, states = needed_over_time(program.step, following, wanted)
    first = needed(program.start, [s.start for s in program.states if s.name in states])
    read = _read(program.step, live) | _read(program.start, first)
    return not read.isdisjoint(trained)


def of_parameters_alone(program: Program, weights: Mapping[str, float]) -> bool:
    """True if the weighted losses depend on parameters only, not on data."""
    counted = [node for loss in program.losses if weights[loss.name] for node in loss.nodes]
    live = zip(needed(program.step, counted), program.step, strict=True)
    kinds = ReadSamples | ReadState | Window
    return not any(kept and isinstance(node.op, kinds) for kept, (_, node) in live)


def _read(graph: Graph, live: Sequence[bool]) -> set[str]:
    return {
        node.op.name
        for kept, (_, node) in zip(live, graph, strict=True)
        if kept and isinstance(node.op, ReadParameter)
    }


def with_reached_corners(
    program: Program,
    optimizer: OptimizerChoice,
    weights: Mapping[str, float],
    stage: str,
    findings: Findings,
) -> Program:
    """The program; penalties that this optimiser cannot minimise exactly become ordinary losses.

    A penalty such as `l1` has a kink at 0. Gradient-based optimisers do not reach it, of which a
    warning goes to `findings`. Penalties with a negative weight become ordinary losses too.
    """
    left = [loss for loss in program.losses if loss.penalty is not None and weights[loss.name]]
    if left and not optimizer.reaches_corners:
        for loss in left:
            findings.report(stages.no_corner(loss.name, optimizer.noun, stage, loss.span))
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
    """Reports an error if parameters have priors, but no loss compares with data that give them a
    scale.
    """
    measured = any(weights[loss.name] and loss.target is not None for loss in program.losses)
    known = [parameter.name for parameter in trained if parameter.prior is not None]
    if known and not measured:
        findings.report(stages.nothing_beside_priors(known, stage, span))


_NOT_OF_SECOND_ORDER: Mapping[str, str] = {
    "batch": "each step takes all starts",
    "lr": "each step has its own length",
    "schedule": "each step has its own length",
    "clip": "the damping limits each step",
}


def check_keys(stage: Stage, findings: Findings) -> None:
    """Reports keys of a stage that have no effect with the optimiser `levenberg_marquardt`."""
    place = stage.optimizer.choice.place.key
    for key, reason in _NOT_OF_SECOND_ORDER.items():
        if key in stage.model_fields_set:
            findings.report(stages.not_of_second_order(key, reason, place))
    if "dtype" in stage.model_fields_set and stage.dtype != "float64":
        reason = "its products lose half of the digits, so that it always runs in float64"
        findings.report(stages.not_of_second_order("dtype", reason, place))


def check_losses(
    stage: str,
    program: Program,
    weights: Mapping[str, float],
    findings: Findings,
) -> None:
    """Reports losses that `levenberg_marquardt` cannot minimise: neither sums of squares nor
    penalties.
    """
    for loss in program.losses:
        weight = weights[loss.name]
        if loss.penalty is not None:
            continue
        if weight < 0 or (weight and not is_sum_of_squares(program.step, loss)):
            op = program.step[loss.prediction].op
            is_penalty = weight > 0 and loss.target is None and op == Apply("abs")
            what = loss.measure.value
            if weight < 0:
                what = "a negative share"
            elif is_penalty:
                what = "l1 of an expression, or of bounded numbers,"
            elif loss.measure is Measure.MEAN:
                what = "an expression"
            found = stages.no_sum_of_squares(
                loss.name, what, loss.span, stage, is_penalty=is_penalty
            )
            findings.report(found)
