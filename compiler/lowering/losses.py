"""Losses: what of each sample is compared with what, and how it becomes a number (R9)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from compiler.builder import GraphBuilder
from compiler.liveness import needed
from compiler.lowering.environment import Environment, Part
from compiler.lowering.expressions import aligning, lower, lower_all
from compiler.lowering.failure import LoweringFailed
from compiler.ops import ReadSignal, ReadState, Window
from compiler.program import Loss, Measure, NodeId, Output
from compiler.types import Type
from spec_schema.errors import names
from spec_schema.expression import Call, Expression, Name
from spec_schema.signals import Loss as LossEntry

if TYPE_CHECKING:
    from compiler.lowering.model import Model

_LOSS = Environment(Part.LOSS)
_COMPARING = {
    "mse": Measure.MSE,
    "rmse": Measure.RMSE,
    "mae": Measure.MAE,
    "huber": Measure.HUBER,
}
_PENALTIES = ("l1", "l2")
LOSS_FUNCTIONS = frozenset({*_COMPARING, *_PENALTIES, "cross_entropy"})
"""Names that stand at the top of a loss and nowhere else."""


def lower_loss(model: Model, name: str, entry: LossEntry) -> Loss:
    """The loss of a `losses:` entry."""
    span = entry.place.key
    match entry.expr:
        case Call(function=Name(name=function)) as call if (
            function in LOSS_FUNCTIONS and function not in model.scope
        ):
            measure, prediction, target = _measured(model, function, call)
        case expression:
            measure, prediction, target = Measure.MEAN, lower(model, expression, _LOSS), None
    return Loss(name, measure, prediction, target, entry.weight, span)


def default_loss(model: Model, output: Output) -> Loss:
    """mse of an output against what it predicts, under the output's name."""
    assert output.predicts is not None
    builder = model.builder(_LOSS)
    found = builder.type(output.node)
    ahead = output.predicts.ahead
    target = builder.log(output.predicts.signal, ahead, ahead, Type(found.axes, found.unit))
    return Loss(output.name, Measure.MSE, output.node, target, 1.0, output.span)


def _measured(model: Model, function: str, call: Call) -> tuple[Measure, NodeId, NodeId | None]:
    if function == "cross_entropy":
        model.findings.report(names.builtin_not_yet(function, call.function.span))
        raise LoweringFailed
    wanted = 1 if function in _PENALTIES else 2
    if len(call.arguments) != wanted or call.keywords:
        found = len(call.arguments) + len(call.keywords)
        plural = "s" if wanted > 1 else ""
        model.findings.report(
            names.wrong_argument_count(
                function, f"{wanted} argument{plural}", found, call.function.span
            )
        )
        raise LoweringFailed
    builder = model.builder(_LOSS)
    if wanted == 1:
        return Measure.MEAN, _penalty(model, function, call.arguments[0]), None
    prediction, target = lower_all(model, call.arguments, _LOSS)
    with aligning(model, function, call, call.arguments[0], call.arguments[1]):
        builder.subtract(prediction, target)  # compares the units of the two
        prediction, target, _ = builder.aligned(prediction, target)
    return _COMPARING[function], *_scored(builder, prediction, target)


def _scored(builder: GraphBuilder, prediction: NodeId, target: NodeId) -> tuple[NodeId, NodeId]:
    """The two values with one from the log alone as target: only there NaN means `not recorded`.

    Every measure is the same for a swapped pair. Two simulated values are compared by their
    difference, the target is 0.
    """
    if not _is_simulated(builder, target):
        return prediction, target
    if not _is_simulated(builder, prediction):
        return target, prediction
    difference = builder.subtract(prediction, target)
    type = builder.type(difference)
    return difference, builder.broadcast(builder.constant(0.0, unit=type.unit), type.axes)


def _is_simulated(builder: GraphBuilder, value: NodeId) -> bool:
    graph = builder.graph()
    return any(
        live and isinstance(node.op, ReadSignal | ReadState | Window)
        for live, node in zip(needed(graph, [value]), graph.nodes, strict=True)
    )


def _penalty(model: Model, function: str, argument: Expression) -> NodeId:
    builder = model.builder(_LOSS)
    value = lower(model, argument, _LOSS)
    return builder.apply("abs", value) if function == "l1" else builder.power(value, 2)
