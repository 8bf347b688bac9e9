"""Lowers losses: the two values that each loss compares in a step, and the measure of their error
(R9).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from compiler.builtins.axes import largest_along, reduce_axes
from compiler.builtins.call_options import option
from compiler.ir.builder import GraphBuilder
from compiler.ir.nodes import needed, reads_simulation
from compiler.ir.ops import Read, ReadParameter, Relation, Window
from compiler.ir.program import Loss, Measure, NodeId, Output, Parameter, Penalty
from compiler.ir.types import UNNAMED, WINDOW, Axis, Type, describe_axes
from compiler.lowering.constants import evaluate, number, refuse_infinite
from compiler.lowering.context import Context, LoweringFailed
from compiler.lowering.environment import Environment, EnvironmentPart
from compiler.lowering.expressions import (
    aligning,
    lower,
    lower_all,
    report_unit_conflicts,
    warn_of_twin_axes,
)
from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.errors import knowledge, names, shapes, states
from spec_schema.expressions.language import LOSS_FUNCTIONS
from spec_schema.expressions.tree import Binary, Call, Expression, Name, Negate, Operator
from spec_schema.late_dataclass import dataclass
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
    """The terms of a `losses:` entry: a single one with the name of the entry, several with the
    names `NAME.mse`, `NAME.mae`, ….

    Each term has the weight of the entry, which a stage can replace, and its own share. Raises
    LoweringFailed after reporting a mistake.
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
    """Reports the option `rows` of the loss `name` if no value that its terms `losses` compare
    differs between rows, and raises LoweringFailed.
    """
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
    """The loss of an output that predicts a signal, used if the spec has no `losses:`: the mean
    squared error to the recorded signal. It has the name of the output.
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
    """δ of the measure `huber`: a constant above 0 in the unit of the error; 1 by default. Reports
    any other value, or a unit that does not fit the node `prediction`, and raises LoweringFailed.
    """
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
    """The node of the weight of each row of the loss `name`: a scalar that depends on recorded data
    only. Reports anything else and raises LoweringFailed.
    """
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
    """The pair (prediction, target), exchanged if only the first value is recorded.

    A NaN of the target means "not recorded" and excludes the sample. All measures are symmetric. If
    both values are simulated, the prediction is their difference and the target 0.
    """
    graph = builder.graph()
    if not reads_simulation(graph, target):
        return prediction, target
    if not reads_simulation(graph, prediction):
        return target, prediction
    difference = builder.subtract(prediction, target)
    type = builder.type(difference)
    return difference, builder.broadcast(builder.constant(0.0, unit=type.unit), type.axes)


@dataclass(frozen=True)
class CostTerm:
    """A term of a loss: `share` times the measure `function`, or times the expression itself if it
    is a cost without measure.
    """

    share: float
    expression: Expression
    function: str | None
    """The name of the measure; None for a cost."""


def terms_of(context: Context, expression: Expression) -> list[CostTerm]:
    """Splits the expression of a loss into its terms. Reports any other arithmetic and raises
    LoweringFailed.

    `mse(a, b) + 0.1 * mae(c) / 2` has the terms 1 · mse(a, b) and 0.05 · mae(c). An expression
    without a measure is a single cost.
    """
    measure = _measure_in(context, expression)
    # already a cost: it is lowered as a whole and averaged over the samples
    if measure is None:
        return [CostTerm(1.0, expression, None)]
    match expression:
        case Call() as call if call is measure:
            assert isinstance(call.function, Name)
            return [CostTerm(1.0, call, call.function.name)]
        case Negate(operand=operand):
            # a negative share is a reward; the total may be negative
            return _scaled(context, -1.0, terms_of(context, operand))
        case Binary(operator=Operator.ADD | Operator.SUBTRACT as operator):
            sign = 1.0 if operator is Operator.ADD else -1.0
            left = terms_of(context, expression.left)
            return left + _scaled(context, sign, terms_of(context, expression.right))
        case Binary(operator=Operator.MULTIPLY, left=left, right=right):
            factor, rest = left, right
            # `0.1 * mse(…)` and `mse(…) * 0.1` are equal; a product of two measures is refused
            if _measure_in(context, left) is not None:
                factor, rest = right, left
            if _measure_in(context, factor) is None:
                return _scaled(context, _constant_factor(context, factor), terms_of(context, rest))
        # a measure in a denominator is refused at the end
        case Binary(operator=Operator.DIVIDE, left=left, right=right):
            if _measure_in(context, right) is None:
                divisor = _constant_factor(context, right)
                if divisor == 0:
                    place = right.span
                    report = names.unfit_constant("the divisor", "is 0", place)
                    context.findings.report(report)
                    raise LoweringFailed
                return _scaled(context, 1 / divisor, terms_of(context, left))
        case _:
            pass
    assert isinstance(measure.function, Name)
    repair = "a loss is a sum of measures, each times a number"
    where = "this arithmetic"
    report = names.misplaced(measure.function.name, where, measure.function.span, repair)
    context.findings.report(report)
    raise LoweringFailed


def _constant_factor(context: Context, expression: Expression) -> float:
    return number(context, expression, "the factor of a loss")


def _scaled(context: Context, factor: float, terms: list[CostTerm]) -> list[CostTerm]:
    for term in terms:
        # a product of finite factors, or a quotient by 1e-320, can overflow
        place = term.expression.span
        refuse_infinite(context, "the factor of this measure", factor * term.share, place)
    return [CostTerm(factor * term.share, term.expression, term.function) for term in terms]


def _measure_in(context: Context, expression: Expression) -> Call | None:
    """The first call of a measure (such as `mse`) or penalty in an expression; None if there is
    none.
    """
    match expression:
        case Call(function=Name(name=name)) as call if (
            name in LOSS_FUNCTIONS and name not in context.scope
        ):
            return call
        case Call(arguments=arguments, keywords=keywords):
            parts = (*arguments, *(keyword.value for keyword in keywords))
        case Binary(left=left, right=right):
            parts = (left, right)
        case Negate(operand=operand):
            parts = (operand,)
        case _:
            parts = ()
    found = (_measure_in(context, part) for part in parts)
    return next((call for call in found if call is not None), None)


PENALTIES = ("l1", "l2", "group")

_WORDS_OF_AXES = {WINDOW: "samples", UNNAMED: "elements"}
"""Names of unnamed axes of arrays in docs/layers.md; the axes of a layer's arrays contain a dot."""


def lower_penalty(context: Context, function: str, call: Call) -> tuple[NodeId, Penalty | None]:
    """The node of the cost of a penalty, `function` being `l1`, `l2` or `group`. Also the penalised
    array, if a proximal step can set its elements or slices to exactly 0, else None.

    l1: |x| and l2: x² of each element, which are averaged. group(A, over=d): the sum over d of the
    Euclidean norm of each slice (Yuan, Lin 2006). Raises LoweringFailed after reporting a mistake.
    """
    builder = context.builder(_LOSS)
    value = lower(context, call.arguments[0], _LOSS)
    op = builder.graph()[value].op
    # an expression such as |2 x − 1| has no simple proximal step: it uses plain gradients
    array = op.name if isinstance(op, ReadParameter) else None
    axes = builder.type(value).axes
    match function:
        case "l2":
            return builder.power(value, 2), None
        case "l1":
            return builder.apply("abs", value), None if array is None else Penalty(array, None)
        case _:
            pass
    if array is None:
        why = "this is an expression"
        context.findings.report(knowledge.no_array_to_group(why, call.arguments[0].span))
        raise LoweringFailed
    over = _penalised_axis(context, call, axes)
    squares = builder.power(value, 2)
    within = [axis.name for axis in axes if axis.name != over]
    norms = builder.apply("sqrt", reduce_axes(builder, squares, within))
    return builder.sum(norms, over), Penalty(array, over)


def checked_penalties(
    losses: Sequence[Loss], parameters: Sequence[Parameter], findings: Findings
) -> list[Loss]:
    """The losses; a penalty remains one only if a proximal step is possible. `parameters` are those
    of the program.

    An l1 penalty of a bounded or fixed array becomes a plain loss. Reports E0967 for `group` of an
    array that has bounds or does not learn, E0968 for several groups of one array.
    """
    known = {parameter.name: parameter for parameter in parameters}
    grouped: set[str] = set()
    checked: list[Loss] = []
    for loss in losses:
        penalty = loss.penalty
        if penalty is not None:
            array = known[penalty.parameter]
            bounded = array.minimum is not None or array.maximum is not None
            # bounded parameters are trained by a raw variable (softplus, sigmoid), in which |x| is
            # differentiable
            if penalty.over is None:
                loss = replace(loss, penalty=None) if bounded or not array.learn else loss
            elif bounded or not array.learn:
                why = f"`{array.name}` {'has bounds' if bounded else 'does not learn'}"
                findings.report(knowledge.no_array_to_group(why, loss.span))
            elif array.name in grouped:
                findings.report(knowledge.several_groups(array.name, loss.span))
            else:
                grouped.add(array.name)
        checked.append(loss)
    return checked


def _penalised_axis(context: Context, call: Call, axes: tuple[Axis, ...]) -> str:
    named = {_WORDS_OF_AXES.get(axis.name, axis.name.rpartition(".")[2]): axis for axis in axes}
    over = option(call, "over")
    if over is None:
        context.findings.report(knowledge.group_over_nothing(tuple(named), call.span))
        raise LoweringFailed
    name = over.name if isinstance(over, Name) else ""
    if name not in named:
        shown = describe_axes(tuple(Axis(word, axis.size) for word, axis in named.items()))
        context.findings.report(shapes.no_such_axis("group", name or "?", shown, over.span))
        raise LoweringFailed
    return named[name].name


def lower_cross_entropy(
    context: Context, call: Call, environment: Environment
) -> tuple[NodeId, NodeId]:
    """The cross entropy −Σᵢ pᵢ log softmax(z)ᵢ = log Σᵢ exp(zᵢ − m) + Σᵢ pᵢ (m − zᵢ), with m = max
    z and Σᵢ pᵢ = 1. Returns the nodes of the cost and of a mark.

    z are the logits, before any softmax, along their last axis other than the window. The target is
    either p along the same axis, or, without that axis, the index of the class from 0. The mark of
    a sample is NaN for a missing target, the target itself if it is not a class, else 0. Reports
    other axes and raises LoweringFailed.
    """
    builder = context.builder(environment)
    logits, target = lower_all(context, call.arguments, environment)
    axes = builder.type(logits).axes
    # the same axis as in `softmax`
    classes = next((axis for axis in reversed(axes) if axis.name != WINDOW), None)
    rest = tuple(axis for axis in axes if axis != classes)
    found = builder.type(target).axes
    if classes is None or set(found) not in ({*axes}, {*rest}):
        what = f"the {'first' if classes is None else 'second'} argument of `cross_entropy`"
        expected = f"{describe_axes(axes)} or {describe_axes(rest)}" if classes else "a vector"
        argument = call.arguments[0 if classes is None else 1]
        shown = describe_axes(axes if classes is None else found)
        context.findings.report(shapes.wrong_axes(what, expected, shown, argument.span))
        raise LoweringFailed
    shares, missing = _class_shares(builder, target, axes, classes)
    # all exponents are ≤ 0, so none overflows; one is 0, so the logarithm's argument is ≥ 1
    largest = largest_along(builder, logits, classes)
    below = builder.subtract(logits, largest)
    total = builder.sum(builder.apply("exp", below), classes.name)
    cost = builder.subtract(
        builder.apply("log", total), builder.sum(builder.multiply(shares, below), classes.name)
    )
    return cost, builder.broadcast(missing, builder.type(cost).axes)


def _class_shares(
    builder: GraphBuilder, target: NodeId, axes: tuple[Axis, ...], classes: Axis
) -> tuple[NodeId, NodeId]:
    """The nodes of p, with the axes of the logits and 0 where the target is missing, and of the
    mark that `lower_cross_entropy` returns. `classes` is the axis of the classes.
    """
    zero = builder.constant(0.0)
    missing = builder.multiply(zero, target)  # NaN stays NaN
    if classes in builder.type(target).axes:
        there = builder.compare(Relation.LESS_EQUAL, target, target)  # false for NaN
        # NaN · 0 would be NaN in the sum: only `missing` excludes samples
        known = builder.select(there, target, zero)
        return builder.broadcast(known, axes), builder.sum(missing, classes.name)
    numbers = builder.constant(np.arange(classes.size), (classes,))
    repeated = builder.broadcast(target, (classes, *builder.type(target).axes))
    away = builder.apply("abs", builder.subtract(repeated, numbers))
    # recorded classes are floats; a NaN is near no class, so all shares are 0
    near = builder.compare(Relation.LESS, away, builder.constant(0.5))
    shares = builder.select(near, builder.constant(1.0), zero)
    # an index without class has no share: the mark makes checks of the data find it
    nowhere = builder.compare(
        Relation.LESS, builder.sum(shares, classes.name), builder.constant(0.5)
    )
    return builder.broadcast(shares, axes), builder.select(nowhere, target, missing)
