"""Finds the origin of a non-finite value in a rollout, and selects the repair."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from compiler.differentiation.interpreted_training import InterpretedTraining
from compiler.differentiation.training_step import training_step
from compiler.interpreter.interpreter import Interpreter
from compiler.interpreter.rounding import Rollouts
from compiler.ir import ops
from compiler.ir.program import Node, NodeId, Program
from msnn.data.dataset import Dataset, FloatArray
from msnn.data.rollout_rows import Runs
from msnn.errors.learning import training as errors
from msnn.errors.learning.stages import no_finite_slope
from msnn.simulation.rollout import RolloutRow, loss_sums, moments
from msnn.training.engines.engine import NonFiniteLossError
from msnn.training.plans.stage_plan import StagePlan
from spec_schema.diagnostics.diagnostic import Diagnostic

_LOOKED_AT = 100
"""Maximum number of rollouts, and of steps of each, in which derivatives are checked."""


def explain_divergence(
    plan: StagePlan,
    dataset: Dataset,
    weights: Mapping[str, FloatArray],
    fault: NonFiniteLossError,
    epoch: int,
    *,
    before_updates: bool = False,
) -> Diagnostic:
    """The diagnostic for the first non-finite value, located by the reference interpreter.

    The interpreter uses the dtype of the stage. `before_updates` is true if the weights are those
    with which the stage began.
    """
    runs = fault.runs
    program = plan.rollout.program
    # a step that overshot: with such a parameter every value is bad, and none of them is the cause
    for parameter in program.parameters:
        if not np.isfinite(weights[parameter.name]).all():
            return errors.diverged_parameter(
                plan.name,
                epoch,
                parameter.name,
                parameter.span,
                has_rate=not plan.optimizer.needs_squares,
            )
    # in the stage's dtype: what overflows in float32 is finite in float64
    judge = Interpreter(program, weights, plan.dtype)
    for moment in moments(judge, dataset.series, runs, losses=True):
        for node in _results(program):
            member = _member_not_finite(moment, node)
            if member is not None:
                origin, inside = _origin(program, moment, node, member)
                start = int(moment.t[min(member, len(moment.t) - 1)]) - moment.number
                begin = dataset.place(start)
                place = f"at step {moment.number} of a rollout from {begin}"
                what = _described(origin) + ("" if inside is None else f" in `{inside}`")
                repair = divergence_repair(
                    program,
                    origin,
                    overflows=_overflows(moment, origin, member),
                    second_order=plan.optimizer.needs_squares,
                    before_updates=before_updates,
                )
                return errors.diverged(plan.name, epoch, what, place, origin.span, repair)
    # every value of every step is finite: a sum of them is not, or a slope
    sums = loss_sums(judge, dataset.series, runs)
    if fault.slopes or all(np.isfinite(one.total) for one in sums.values()):
        names = fault.slopes or _without_slope(plan, dataset, weights, runs)
        spans = [program.parameter(name).span for name in names]
        return no_finite_slope(plan.name, epoch, names, next(iter(spans), plan.span))
    repair = "give the losses smaller weights or units in which values are smaller"
    if not before_updates and not plan.optimizer.needs_squares:
        repair = f"try a smaller learning rate, or {repair}"
    return errors.diverged(plan.name, epoch, "the loss", "summed over a batch", plan.span, repair)


def _without_slope(
    plan: StagePlan, dataset: Dataset, weights: Mapping[str, FloatArray], runs: Runs
) -> tuple[str, ...]:
    """The trained parameters with a non-finite derivative, in the first rollouts."""
    steps = min(int(runs.steps[0]), _LOOKED_AT)
    t0 = runs.t0[runs.steps >= steps][:_LOOKED_AT]
    # at least one step is scored, or there would be no slope to look at
    few = Rollouts(dataset.series, t0, steps, min(plan.rollout.skip, steps - 1))
    training = InterpretedTraining(training_step(plan.program), weights, np.dtype(plan.dtype))
    gradient = training.losses(few, plan.loss_weights).gradient
    # a factor of 0 keeps a parameter where it is, whatever its slope
    moving = [name for name in plan.trained if plan.lr_factors.get(name) != 0]
    return tuple(name for name in moving if not np.isfinite(gradient[name].value).all())


def _results(program: Program) -> list[NodeId]:
    return [state.next for state in program.states] + [loss.prediction for loss in program.losses]


def _member_not_finite(moment: RolloutRow, node: NodeId) -> int | None:
    """The index of the first rollout in which the node's value is not finite; None if all are."""
    value = moment.values.nodes[node]
    if value is None:
        return None
    fine = np.isfinite(value).reshape(len(value), -1).all(axis=1)
    return None if fine.all() else int(np.argmin(fine))


def _origin(
    program: Program, moment: RolloutRow, node: NodeId, member: int
) -> tuple[Node, str | None]:
    """The node that is not finite although its operands are, and the equation that needs it."""
    inside: str | None = None
    while True:
        here = program.step[node]
        before = next((arg for arg in here.args if _is_bad(moment, arg, member)), None)
        if before is None:
            return here, inside if here.label is None else None
        node, inside = before, here.label or inside


def _is_bad(moment: RolloutRow, node: NodeId, member: int) -> bool:
    value = moment.values.nodes[node]
    return value is not None and not np.isfinite(value[min(member, len(value) - 1)]).all()


def _overflows(moment: RolloutRow, node: Node, member: int) -> bool:
    """True if a value overflows; false if its argument is outside the domain of a function."""
    values = [moment.values.nodes[argument] for argument in node.args]
    known = [v[min(member, len(v) - 1)] for v in values if v is not None]
    match node.op:
        case ops.Divide():
            return len(known) < 2 or bool(np.all(known[1] != 0))
        case ops.Apply("pow"):
            return bool(np.all(known[0] >= 0)) if known else True
        case ops.Apply("sqrt" | "log" | "asin" | "acos"):
            return False
        case _:
            return True


def _described(node: Node) -> str:
    if node.label is not None:
        return f"`{node.label}`"
    match node.op:
        case ops.Apply(function):
            return f"`{function}`"
        case ops.ReadSignal(name) | ops.ReadLog(name):
            return f"the signal `{name}`"
        case ops.ReadState(name):
            return f"the state `{name}`"
        case ops.Divide():
            return "a quotient"
        case ops.Multiply() | ops.Contract():
            return "a product"
        case ops.Add() | ops.Subtract() | ops.Sum():
            return "a sum"
        case _:
            return "a value"


_IN_DOMAIN: Mapping[str, str] = {
    "sqrt": "`sqrt(max(x, 0))` for `sqrt(x)`: x falls below 0 there",
    "log": "`log(max(x, 1e-9))` for `log(x)`: x is not above 0 there",
    "asin": "`asin(clip(x, -1, 1))` for `asin(x)`: x leaves [-1, 1] there",
    "acos": "`acos(clip(x, -1, 1))` for `acos(x)`: x leaves [-1, 1] there",
    "pow": "`max(x, 0) ** p` for `x ** p`: x falls below 0 there",
}
"""Functions with a limited domain, and a formula that stays within it."""

_DIVISOR = "a divisor that cannot be 0, as `max(d, 1e-9)` for a `d` that is never below 0"

_STIFF = (
    "`integrator: {rk4: {substeps: 10}}` or `linear_implicit` of the states whose `der:` grows: "
    "the step is too long for them"
)


def divergence_repair(
    program: Program, origin: Node, *, overflows: bool, second_order: bool, before_updates: bool
) -> str:
    """The advice of the diagnostic about a non-finite value, as a text.

    `origin` is the first non-finite value; `overflows` is true if it is too large. Before any
    update, the weights are those of the spec, so learning rate and step limits would not help.
    """
    if not overflows:
        match origin.op:
            case ops.Apply(function) if function in _IN_DOMAIN:
                return f"write {_IN_DOMAIN[function]}"
            case ops.Divide():
                return f"write {_DIVISOR}"
            case _:
                pass
    repairs: list[str] = []
    # a state of which a formula gives the derivative is integrated
    if any(formula.left.startswith("der(") for formula in program.formulas):
        repairs.append(_STIFF)
    if before_updates:
        repairs.append("initial values with which the rollout stays finite")
    elif second_order:
        repairs.append("weights to begin with that are nearer")
    else:
        repairs.append("a smaller learning rate, `clip:`")
    return f"try {', '.join(repairs)}, a shorter horizon, or bounds"
