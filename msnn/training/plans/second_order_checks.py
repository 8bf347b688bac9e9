"""Checks a stage for settings that levenberg_marquardt does not support."""

from __future__ import annotations

from collections.abc import Mapping

from compiler.differentiation.sums_of_squares import is_sum_of_squares
from compiler.ir.ops import Apply
from compiler.ir.program import Measure, Program
from msnn.errors.learning import second_order
from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.sections.training import Stage

_NOT_OF_SECOND_ORDER: Mapping[str, str] = {
    "batch": "each step takes all starts",
    "lr": "each step has its own length",
    "schedule": "each step has its own length",
    "clip": "the damping limits each step",
}


def check_keys(stage: Stage, findings: Findings) -> None:
    """Reports keys of other optimisers that have no effect on levenberg_marquardt."""
    place = stage.optimizer.choice.place.key
    for key, reason in _NOT_OF_SECOND_ORDER.items():
        if key in stage.model_fields_set:
            findings.report(second_order.not_of_second_order(key, reason, place))
    if "dtype" in stage.model_fields_set and stage.dtype != "float64":
        reason = "its products lose half of the digits, so that it always runs in float64"
        findings.report(second_order.not_of_second_order("dtype", reason, place))


def check_losses(
    stage: str,
    program: Program,
    weights: Mapping[str, float],
    findings: Findings,
) -> None:
    """Reports losses that are neither sums of squares nor non-smooth penalties."""
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
            found = second_order.no_sum_of_squares(
                loss.name, what, loss.span, stage, is_penalty=is_penalty
            )
            findings.report(found)
