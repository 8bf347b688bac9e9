"""Lowers losses: the compared values of each sample and the measure of their error (R9)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from compiler.builtins.call_options import option
from compiler.elaboration.losses.cross_entropy import lower_cross_entropy
from compiler.elaboration.losses.loss_terms import terms_of
from compiler.elaboration.losses.penalties import PENALTIES, lower_penalty
from compiler.ir.builder import GraphBuilder
from compiler.ir.liveness import needed, reads_simulation
from compiler.ir.ops import Read, ReadParameter, Window
from compiler.ir.program import Loss, Measure, NodeId, Output
from compiler.ir.types import Type, describe_axes
from compiler.lowering.aligning import aligning, warn_of_twin_axes
from compiler.lowering.constants import evaluate, number
from compiler.lowering.context import Context
from compiler.lowering.environment import Environment, EnvironmentPart
from compiler.lowering.expressions import lower, lower_all
from compiler.lowering.failure import LoweringFailed
from compiler.lowering.unit_conflicts import report_unit_conflicts
from spec_schema.errors import names, shapes, states
from spec_schema.expressions.language import LOSS_FUNCTIONS
from spec_schema.expressions.tree import Call, Expression
from spec_schema.sections.signals import Loss as LossEntry
from spec_schema.units.unit import ONE

_LOSS = Environment(EnvironmentPart.LOSS)
_COMPARING = {
    "mse": Measure.MSE,
    "rmse": Measure.RMSE,
    "mae": Measure.MAE,
    "huber": Measure.HUBER,
}


def lower_loss(context: Context, name: str, entry: LossEntry) -> list[Loss]:
    """The terms of a `losses:` entry: one under its name, or `NAME.mse`, `NAME.mae`, ….

    Each term has the weight of the entry, which a stage can replace, and its own share.
    """
    terms = terms_of(context, entry.expr)
    rows = None if entry.rows is None else _factor_of_rows(context, name, entry.rows)
    losses: list[Loss] = []
    taken = Counter[str]()
    for term in terms:
        penalty, delta = None, 1.0
        if term.function is None:
            cost = lower(context, term.expression, _LOSS)
            measure, prediction, target = Measure.MEAN, cost, None
        else:
            assert isinstance(term.expression, Call)
            _check_arguments(context, term.function, term.expression)
            if term.function in PENALTIES:
                prediction, penalty = lower_penalty(context, term.function, term.expression)
                measure, target = Measure.MEAN, None
            else:
                measure, prediction, target = _measured(context, term.function, term.expression)
                delta = _delta(context, term.function, term.expression, prediction)
        label = term.function or "cost"
        taken[label] += 1
        # two terms with one measure are named `NAME.mse` and `NAME.mse2`
        again = str(taken[label]) if taken[label] > 1 else ""
        own = name if len(terms) == 1 else f"{name}.{label}{again}"
        span = entry.place.key if len(terms) == 1 else term.expression.span
        losses.append(
            Loss(
                name=own,
                measure=measure,
                prediction=prediction,
                target=target,
                weight=entry.weight,
                share=term.share,
                delta=delta,
                penalty=penalty,
                span=span,
                # a penalty applies to an array, which has no rows
                rows=rows if penalty is None else None,
            )
        )
    if entry.rows is not None:
        _check_rows_count(context, name, entry.rows, losses)
    return losses


def _check_rows_count(
    context: Context, name: str, rows: Expression, losses: Sequence[Loss]
) -> None:
    """Reports `rows` of a loss none of whose values differs between rows."""
    graph = context.builder(_LOSS).graph()
    values = [loss.prediction for loss in losses]
    values += [loss.target for loss in losses if loss.target is not None]
    live = needed(graph, values)
    # data and states differ between rows, parameters do not
    varies = (
        kept and isinstance(node.op, Read | Window) and not isinstance(node.op, ReadParameter)
        for kept, node in zip(live, graph.nodes, strict=True)
    )
    if not any(varies):
        context.findings.report(states.rows_of_no_rows(name, rows.span))
        raise LoweringFailed


def default_loss(context: Context, output: Output) -> Loss:
    """The loss of a predicting output without `losses:`: the MSE to its target, named as the
    output.
    """
    assert output.predicts is not None
    builder = context.builder(_LOSS)
    found = builder.type(output.node)
    ahead = output.predicts.ahead
    # the recorded sample t+k, which the output at t predicts (R4)
    target = builder.log(output.predicts.signal, ahead, ahead, Type(found.axes, found.unit))
    return Loss(output.name, Measure.MSE, output.node, target, span=output.span, is_default=True)


def _check_arguments(context: Context, function: str, call: Call) -> None:
    signature = LOSS_FUNCTIONS[function]
    for keyword in call.keywords:
        if keyword.name not in signature.keywords:
            context.findings.report(
                names.unknown_keyword(function, keyword.name, keyword.span, signature.keywords)
            )
            raise LoweringFailed
    found = len(call.arguments)
    if not signature.takes(found):
        context.findings.report(
            names.wrong_argument_count(
                function, signature.wanted, found, call.function.span, signature.keywords
            )
        )
        raise LoweringFailed


def _measured(context: Context, function: str, call: Call) -> tuple[Measure, NodeId, NodeId | None]:
    builder = context.builder(_LOSS)
    if function == "cross_entropy":
        cost, missing = lower_cross_entropy(context, call, _LOSS)
        # only recorded values can be missing
        return Measure.MEAN, cost, None if reads_simulation(builder.graph(), missing) else missing
    if len(call.arguments) == 1:  # one argument is compared with 0
        value = lower(context, call.arguments[0], _LOSS)
        type = builder.type(value)
        zero = builder.broadcast(builder.constant(0.0, unit=type.unit), type.axes)
        return _COMPARING[function], value, zero
    prediction, target = lower_all(context, call.arguments, _LOSS)
    operands = zip(call.arguments, (prediction, target), strict=True)
    warn_of_twin_axes(context, builder, function, call, operands)
    with aligning(context, function, call, call.arguments[0], call.arguments[1]):
        builder.subtract(prediction, target)  # checks the units of both
        prediction, target, _ = builder.aligned(prediction, target)
    report_unit_conflicts(context, builder, call, function)
    return _COMPARING[function], *_scored(builder, prediction, target)


def _delta(context: Context, function: str, call: Call, prediction: NodeId) -> float:
    """δ of `huber`: a constant > 0 in the unit of the error; default 1."""
    given = option(call, "delta")
    if given is None:
        return 1.0
    what = f"`delta` of `{function}`"
    delta = number(context, given, what)
    if delta <= 0:
        context.findings.report(names.unfit_constant(what, "is not above 0", given.span))
        raise LoweringFailed
    unit = evaluate(context, given).unit
    if unit in (None, ONE):  # a bare number is in the unit of the error
        return delta
    builder = context.builder(_LOSS)
    limit = builder.constant(delta, unit=unit)
    with aligning(context, function, call, call.arguments[0], given):
        builder.maximum(prediction, limit)  # compares the units of the two; nothing reads it
    report_unit_conflicts(context, builder, given, f"{function}, delta")
    return delta


def _factor_of_rows(context: Context, name: str, expression: Expression) -> NodeId:
    """The weight of each row: a scalar that depends on recorded data only."""
    builder = context.builder(_LOSS)
    node = lower(context, expression, _LOSS)
    axes = builder.type(node).axes
    if axes:
        what, found = f"`rows` of `{name}`", describe_axes(axes)
        context.findings.report(shapes.wrong_axes(what, "a scalar", found, expression.span))
        raise LoweringFailed
    graph = builder.graph()
    learned = any(
        live and isinstance(each.op, ReadParameter)
        for live, each in zip(needed(graph, [node]), graph.nodes, strict=True)
    )
    if learned or reads_simulation(graph, node):
        read = "a parameter" if learned else "a value of the simulation"
        context.findings.report(states.rows_of_no_log(name, read, expression.span))
        raise LoweringFailed
    return node


def _scored(builder: GraphBuilder, prediction: NodeId, target: NodeId) -> tuple[NodeId, NodeId]:
    """Orders the pair so that the target is the recorded value, where NaN means `not recorded`.

    All measures are symmetric. If both values are simulated, their difference is compared with 0.
    """
    graph = builder.graph()
    if not reads_simulation(graph, target):
        return prediction, target
    if not reads_simulation(graph, prediction):
        return target, prediction
    difference = builder.subtract(prediction, target)
    type = builder.type(difference)
    return difference, builder.broadcast(builder.constant(0.0, unit=type.unit), type.axes)
