"""Checks initial states that are estimated from the data: enough samples, and a loss (R7)."""

from __future__ import annotations

from collections.abc import Sequence

from compiler.differentiation.estimated_starts import evaluations_that_decide
from compiler.ir.program import Loss, Measure, State
from compiler.ir.types import Type
from compiler.lowering.context import Context
from compiler.lowering.failure import LoweringFailed
from spec_schema.errors import states as errors
from spec_schema.sections import signals


def fit_over(context: Context, entry: signals.State) -> int | None:
    """Number of samples that estimate a state's initial value; see `State.fit_over`."""
    if entry.init is None or entry.init.fit is None:
        return None
    over = entry.init.fit.over
    if over == "record":
        return 0
    try:
        return context.sampling.samples(over)
    except LoweringFailed:
        return None


def check_fitted_starts(context: Context, states: Sequence[State], losses: Sequence[Loss]) -> None:
    """Reports estimated initial values with fewer samples than unknowns, or without a loss."""
    estimated = [state for state in states if state.fit_over is not None]
    numbers = sum(Type(state.axes).size for state in estimated)
    most = evaluations_that_decide(estimated)
    # one report for all of them, at the first one
    for state in estimated[:1]:
        entry = context.spec.states[state.name]
        assert entry.init is not None
        assert entry.init.fit is not None
        names = [one.name for one in estimated]
        # fewer equations than unknowns: the estimate would not be unique
        over = entry.init.fit.over
        if most is not None and most < numbers and over != "record":
            place = over.span
            context.findings.report(errors.too_few_for_starts(names, most, numbers, place))
        # a loss with a mistake of its own is reported already and may compare with data
        known = _wanted(context) <= {loss.entry for loss in losses}
        if known and all(loss.measure is Measure.MEAN for loss in losses):
            place = entry.init.fit.place.key
            context.findings.report(errors.starts_of_nothing(state.name, place))


def _wanted(context: Context) -> set[str]:
    """The entries under `losses:`, or the outputs that have a default loss."""
    predicting = {name for name, output in context.spec.outputs.items() if output.predicts}
    return {*context.spec.losses} if context.spec.losses else predicting
