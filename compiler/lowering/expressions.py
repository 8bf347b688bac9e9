"""Lowers expressions of the spec to nodes. Names and calls are looked up by `context.names`."""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction
from itertools import combinations
from typing import assert_never

from compiler.ir.builder import GraphBuilder
from compiler.ir.ops import Constant
from compiler.ir.ops import Negate as CoreNegate
from compiler.ir.ops import Relation as CoreRelation
from compiler.ir.program import NodeId
from compiler.ir.rules import AxisConflict, UnitConflict, contracted, power_unit, twin_axes
from compiler.ir.types import UNNAMED, WINDOW, Axis, describe_axes
from compiler.lowering.context import Context, LoweringFailed
from compiler.lowering.environment import Environment
from spec_schema.diagnostics.source import Span
from spec_schema.errors import shapes, time, units
from spec_schema.expressions import tree
from spec_schema.expressions.tree import Binary, Expression, Number, expression_text, number_text
from spec_schema.sections.signals import Input
from spec_schema.units.parser import parse_unit
from spec_schema.units.unit import ONE, Unit


def report_unit_conflicts(
    context: Context, builder: GraphBuilder, expression: Expression, operation: str | None = None
) -> None:
    """Reports the unit conflicts that the builder collected while it lowered `expression`, and
    clears them.

    `operation` is the user's spelling of the operation, if it differs from the name of the node.
    """
    for conflict in builder.conflicts:
        secondary = ()
        if isinstance(expression, Binary):
            secondary = (
                (expression.left.span, f"this is in {conflict.expected.text}"),
                (expression.right.span, f"this is in {conflict.found.text}"),
            )
        context.findings.report(
            units.units_differ(
                operation or conflict.operation,
                conflict.found.text,
                conflict.expected.text,
                expression.span,
                secondary,
                bare=_bare_number(conflict, expression),
                factor=_scale_between(conflict),
            )
        )
    builder.conflicts.clear()


def report_declared_unit(
    context: Context, name: str, found: Unit, declared: Unit, span: Span
) -> None:
    """Reports that the expression of the entry `name` has the unit `found`, although the entry
    declares the unit `declared`.
    """
    is_temperature = found.same_dimension(declared) and found.offset != declared.offset
    context.findings.report(
        units.declared_unit_differs(
            name, found.text, declared.text, span, is_temperature=is_temperature
        )
    )


def _bare_number(conflict: UnitConflict, expression: Expression) -> str | None:
    """A repair of a unit conflict as text: if one operand is a number without unit, this number
    with the unit of the other operand. None otherwise.
    """
    if not isinstance(expression, Binary):
        return None
    for side, unit in ((expression.left, conflict.found), (expression.right, conflict.expected)):
        if isinstance(side, Number):
            return f"{number_text(side.value)} {unit.text}"
    return None


def _scale_between(conflict: UnitConflict) -> float | None:
    """The factor that converts the actual unit of a unit conflict to the expected one; None if
    their dimensions differ or the factor is 1.
    """
    found, expected = conflict.found, conflict.expected
    factor = found.factor_to(expected) if found.same_dimension(expected) else 1.0
    return None if factor == 1.0 else factor


class aligning:  # noqa: N801  (read as a verb: `with aligning(…):`)
    """A context manager that reports an AxisConflict raised in its block, then raises
    LoweringFailed.

    The diagnostic names the operation and points to the expression `whole` and its operands `left`
    and `right`.
    """

    def __init__(
        self,
        context: Context,
        operation: str,
        whole: Expression,
        left: Expression,
        right: Expression,
    ) -> None:
        self._facts = context, operation, whole, left, right

    def __enter__(self) -> None:
        return None

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        if isinstance(error, AxisConflict):
            context, operation, whole, left, right = self._facts
            context.findings.report(
                shapes.axes_differ(
                    operation,
                    describe_axes(error.left),
                    describe_axes(error.right),
                    error.reason,
                    whole.span,
                    left.span,
                    right.span,
                    error.hint or None,
                )
            )
            raise LoweringFailed from error


def warn_of_twin_axes(
    context: Context,
    builder: GraphBuilder,
    operation: str,
    whole: Expression,
    operands: Iterable[tuple[Expression, NodeId]],
) -> None:
    """Warns about the first two operands that would form an outer product, probably by mistake (see
    `twin_axes`). `operands` are pairs of an expression and its node, `whole` is the operation's
    expression.
    """
    typed = [(operand.span, builder.type(node).axes) for operand, node in operands]
    for (left, left_axes), (right, right_axes) in combinations(typed, 2):
        try:
            found = twin_axes(left_axes, right_axes)
        except AxisConflict:
            return  # which the operation itself reports
        if found is not None:
            sides = (left, describe_axes(left_axes)), (right, describe_axes(right_axes))
            context.findings.report(
                shapes.twin_axes(operation, found.name, found.size, whole.span, *sides)
            )
            return


def moving_input(
    context: Context, name: str, entry: Input, environment: Environment
) -> NodeId | None:
    """The value (1−τ)·u[t] + τ·u[t+1] of the input u = `name` with `between: linear` at an
    integrator stage; τ is the elapsed fraction of the step.

    Returns None outside of integrator stages, and for an input without interpolation. The value
    lies between the two samples, so the range of the input also holds for it.
    """
    stage = environment.stage
    if stage is None or environment.is_elsewhere or not entry.is_linear:
        return None
    builder = context.builder(environment)
    type, fraction = context.type_of(entry), stage.fraction
    if fraction in (0, 1):
        return builder.signal(name, int(fraction), int(fraction), type)
    now, following = (builder.signal(name, at, at, type) for at in (0, 1))
    before = builder.multiply(builder.constant(float(1 - fraction)), now)
    after = builder.multiply(builder.constant(float(fraction)), following)
    interpolated = builder.add(before, after)
    builder.name(interpolated, f"{name}_at_{fraction.numerator}_{fraction.denominator}")
    return interpolated


# Up to here squaring needs at most 10 products; larger exponents are left to `pow`.
LARGEST_POWER = 64
_SECOND = parse_unit("s")
_RELATIONS = {
    tree.Relation.LESS: CoreRelation.LESS,
    tree.Relation.LESS_EQUAL: CoreRelation.LESS_EQUAL,
    tree.Relation.GREATER: CoreRelation.GREATER,
    tree.Relation.GREATER_EQUAL: CoreRelation.GREATER_EQUAL,
}


def lower(context: Context, expression: tree.Expression, environment: Environment) -> NodeId:
    """The node of an expression in an environment. Raises LoweringFailed after reporting its
    mistakes.
    """
    builder = context.builder(environment)
    with builder.at(expression.span):
        node = _lower(context, expression, environment, builder)
    context.refuse_vast(builder.type(node).axes, expression.span)
    # operands have reported theirs: the remaining conflicts belong to this operation
    report_unit_conflicts(context, builder, expression)
    return node


def lower_all(
    context: Context, expressions: Iterable[tree.Expression], environment: Environment
) -> list[NodeId]:
    """The nodes of several expressions, in order. Raises LoweringFailed after reporting the
    mistakes of all.
    """
    nodes: list[NodeId] = []
    failed = False
    for expression in expressions:
        try:
            nodes.append(lower(context, expression, environment))
        except LoweringFailed:
            failed = True
    if failed:
        raise LoweringFailed
    return nodes


def lower_operands(
    context: Context, expressions: Iterable[tree.Expression], environment: Environment
) -> list[NodeId]:
    """The nodes of the operands of an elementwise operation, in order. Raises LoweringFailed after
    reporting the mistakes of all.

    Over a window, an operand with dims but without window is constant in time, so it is repeated
    along the window. Otherwise a dim that happens to have the window's length would match it (R3).
    """
    nodes = lower_all(context, expressions, environment)
    builder = context.builder(environment)
    lengths = {length for node in nodes if (length := builder.type(node).window) is not None}
    if environment.window is None or len(lengths) != 1:
        return nodes
    along = Axis(WINDOW, lengths.pop())
    axes = [builder.type(node).axes for node in nodes]
    steady = [bool(own) and along not in own for own in axes]
    every = zip(nodes, axes, steady, strict=True)
    return [builder.broadcast(n, (*own, along)) if same else n for n, own, same in every]


def _lower(
    context: Context, expression: tree.Expression, environment: Environment, builder: GraphBuilder
) -> NodeId:
    match expression:
        case tree.Number(value=value):
            return builder.constant(value)
        case tree.Duration():
            return builder.constant(expression.seconds, unit=_SECOND)
        case tree.Name():
            return context.names.value(expression, environment)
        case tree.Member():
            return context.names.member(expression, environment)
        case tree.Call():
            return context.names.call(expression, environment)
        case tree.Negate(operand=operand):
            return builder.negate(lower(context, operand, environment))
        case tree.Binary():
            return _lower_binary(context, expression, environment, builder)
        case tree.Compare(relation=relation, left=left, right=right):
            nodes = lower_operands(context, (left, right), environment)
            operands = zip((left, right), nodes, strict=True)
            warn_of_twin_axes(context, builder, relation.value, expression, operands)
            with aligning(context, relation.value, expression, left, right):
                return builder.compare(_RELATIONS[relation], *nodes)
        case tree.Window() | tree.Past() | tree.Future():
            return _lower_window(context, expression, environment)
        case tree.ListLiteral(elements=elements):
            return _lower_list(context, elements, environment, builder)
        case _:
            assert_never(expression)


def _lower_binary(
    context: Context, binary: tree.Binary, environment: Environment, builder: GraphBuilder
) -> NodeId:
    contracts = binary.operator is tree.Operator.CONTRACT
    lower_both = lower_all if contracts else lower_operands
    left, right = lower_both(context, (binary.left, binary.right), environment)
    if not contracts:
        operands = ((binary.left, left), (binary.right, right))
        warn_of_twin_axes(context, builder, binary.operator.value, binary, operands)
    with aligning(context, binary.operator.value, binary, binary.left, binary.right):
        match binary.operator:
            case tree.Operator.ADD:
                return builder.add(left, right)
            case tree.Operator.SUBTRACT:
                return builder.subtract(left, right)
            case tree.Operator.MULTIPLY:
                return builder.multiply(left, right)
            case tree.Operator.DIVIDE:
                return builder.divide(left, right)
            case tree.Operator.CONTRACT:
                return _lower_contraction(context, binary, environment, builder, left, right)
            case tree.Operator.POWER:
                return _lower_power(builder, left, right)


def _lower_contraction(
    context: Context,
    binary: tree.Binary,
    environment: Environment,
    builder: GraphBuilder,
    left: NodeId,
    right: NodeId,
) -> NodeId:
    if environment.window is not None:
        left_type, right_type = builder.type(left), builder.type(right)
        # the user did not write the window of the environment, so `@` must not sum over it
        if left_type.window is not None or contracted(left_type.axes, right_type.axes)[1] == WINDOW:
            context.findings.report(time.unkept_past("a contraction over time", binary.span))
            raise LoweringFailed
    return builder.contract(left, right)


def _lower_power(builder: GraphBuilder, base: NodeId, exponent: NodeId) -> NodeId:
    """The node of base^exponent. A constant integer exponent up to LARGEST_POWER becomes products
    in a fixed order, 1/2 a square root, any other the function `pow`.
    """
    value = literal(builder, exponent)
    if value is not None and value.is_integer() and abs(value) <= LARGEST_POWER:
        return builder.power(base, int(value))
    if value == 0.5:
        return builder.apply("sqrt", base)
    unit = builder.type(base).unit
    node = builder.apply("pow", base, exponent)
    if unit is not None and value is not None and not unit.same_as(ONE):
        # `pow` requires dimensionless operands, but a literal exponent determines the unit
        builder.conflicts.clear()
        # 1/3 is rounded to a double: the unit uses the nearby fraction
        exact = Fraction(value).limit_denominator(1000)
        builder.set_unit(node, power_unit(unit, exact))
    return node


def literal(builder: GraphBuilder, node: NodeId) -> float | None:
    """The value of a node that is a scalar constant, or the negative of one; None for any other
    node.
    """
    constant = builder.node(node)
    if isinstance(constant.op, CoreNegate):
        value = literal(builder, constant.args[0])
        return None if value is None else -value
    if isinstance(constant.op, Constant) and constant.type.axes == ():
        return constant.op.values[0]
    return None


def _lower_window(
    context: Context, expression: tree.Window | tree.Past | tree.Future, environment: Environment
) -> NodeId:
    sampling = context.sampling
    if context.sampling.sample_time is None:
        context.findings.report(time.needs_sample_time("a time window", expression.span))
        raise LoweringFailed
    match expression:
        case tree.Window(first=first, last=None):
            # `e[t-1]` is a shift, not a window: every signal in e is read one sample earlier (R1)
            return lower(context, expression.operand, environment.shifted(sampling.offset(first)))
        case tree.Window(first=first, last=last):
            assert last is not None
            bounds = (sampling.offset(first), sampling.offset(last))
        case tree.Past(length=length):
            # `x.past(3)` is x[t-2:t]: the newest sample is one of the three (R1)
            bounds = (1 - _positive(context, length.span, sampling.samples(length)), 0)
        # the first sample is t+1: the sample at t is not in the future
        case tree.Future(length=length):
            bounds = (1, _positive(context, length.span, sampling.samples(length)))
    if bounds[0] > bounds[1]:
        context.findings.report(time.empty_window(expression.span))
        raise LoweringFailed
    return window_of(context, expression.operand, environment, *bounds)


def _positive(context: Context, span: Span, samples: int) -> int:
    if samples < 1:
        context.findings.report(time.bad_length(span))
        raise LoweringFailed
    return samples


def window_of(
    context: Context, operand: tree.Expression, environment: Environment, first: int, last: int
) -> NodeId:
    """The node of the samples t+first … t+last of the expression `operand`: each signal in it is
    read over that window. A window of a window is reported and raises LoweringFailed.
    """
    if environment.window is not None:
        context.findings.report(time.window_of_window(operand.span))
        raise LoweringFailed
    node = lower(context, operand, environment.over(first, last))
    builder = context.builder(environment)
    if builder.type(node).window is None:
        # it does not depend on time: the same value at every sample
        axes = (*builder.type(node).axes, Axis(WINDOW, last - first + 1))
        node = builder.broadcast(node, axes)
    return node


def _lower_list(
    context: Context,
    elements: tuple[tree.Expression, ...],
    environment: Environment,
    builder: GraphBuilder,
) -> NodeId:
    nodes = lower_all(context, elements, environment)
    for element, node in zip(elements, nodes, strict=True):
        axes = builder.type(node).axes
        if axes:
            found = describe_axes(axes)
            listed = ", ".join(expression_text(each) for each in elements)
            repair = (
                f"`stack({listed}, dim=NAME)` puts values with dims side by side, along a dim "
                f"NAME of {len(elements)}"
            )
            context.findings.report(
                shapes.wrong_axes(
                    "an element of a list", "a scalar", found, element.span, repair=repair
                )
            )
            raise LoweringFailed
    # a scalar needs an axis to be concatenated along
    parts = [builder.reshape(node, (Axis(UNNAMED, 1),)) for node in nodes]
    return parts[0] if len(parts) == 1 else builder.concat(parts, UNNAMED, "[ ]")
