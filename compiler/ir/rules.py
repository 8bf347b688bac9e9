"""The rules of operations: how the axes of operands are matched, the type that each operation
requires, and the unit of its result.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from fractions import Fraction
from typing import assert_never

from compiler.ir import ops
from compiler.ir.program import Node
from compiler.ir.scalars import SCALAR_FUNCTIONS, UnitRule
from compiler.ir.types import UNNAMED, WINDOW, Axis, Type, describe_axes, in_order
from spec_schema.late_dataclass import dataclass
from spec_schema.units.parser import parse_unit
from spec_schema.units.unit import ONE, Unit


class AxisConflict(Exception):  # noqa: N818  (a finding to report, not a failure)
    """Raised for two operands, `left` and `right`, whose axes do not fit. `reason` is a clause for
    the message, `hint` a repair or empty.
    """

    def __init__(
        self, left: tuple[Axis, ...], right: tuple[Axis, ...], reason: str, hint: str = ""
    ):
        super().__init__(f"{describe_axes(left)} and {describe_axes(right)}: {reason}")
        self.left = left
        self.right = right
        self.reason = reason
        self.hint = hint


def _named(axes: tuple[Axis, ...], name: str) -> Axis | None:
    return next((axis for axis in axes if axis.name == name), None)


def _with_window(axes: tuple[Axis, ...], other: tuple[Axis, ...]) -> tuple[Axis, ...]:
    """The axes of an operand, with one axis renamed to the window of the other operand if it has
    none itself.

    That axis is the unnamed one, or else the last named one that `other` lacks, provided that it
    has the length of the window. It becomes the last axis. Example: `W * delta.past(30)`.
    """
    window = _named(other, WINDOW)
    if window is None or _named(axes, WINDOW) is not None:
        return axes
    names = {axis.name for axis in other}
    # if both operands have an unnamed axis, these two match, elementwise
    candidates = [axis for axis in axes if axis.name == UNNAMED and axis.name not in names]
    # only the last named axis that the other operand lacks is a candidate (R3)
    candidates += [axis for axis in reversed(axes) if axis.name and axis.name not in names][:1]
    along = next((axis for axis in candidates if axis.size == window.size), None)
    if along is None:
        return axes
    return in_order(tuple(window if axis is along else axis for axis in axes))


def align(
    left: tuple[Axis, ...], right: tuple[Axis, ...]
) -> tuple[tuple[Axis, ...], tuple[Axis, ...], tuple[Axis, ...]]:
    """Returns the axes of an elementwise result, and the axes of `left` and `right` after a
    renaming that makes them part of the result.

    Renaming preserves the order of elements, except that a new window axis moves to the end. The
    caller then broadcasts both operands. Raises AxisConflict if axes of one name differ in length.
    """
    # each operand is compared with the original axes of the other: after a renaming the second
    # search would match the window again
    left_axes, right_axes = _with_window(left, right), _with_window(right, left)
    result = list(left_axes)
    for axis in right_axes:
        mine = _named(left_axes, axis.name)
        if mine is None:
            result.append(axis)
        elif mine.size != axis.size:
            name = {WINDOW: "windows", UNNAMED: "unnamed axes"}.get(axis.name, f"`{axis.name}`")
            raise AxisConflict(left, right, f"{name} of {mine.size} and {axis.size} elements")
    return in_order(tuple(result)), left_axes, right_axes


def twin_axes(left: tuple[Axis, ...], right: tuple[Axis, ...]) -> Axis | None:
    """The named axis of one operand that is as long as the unnamed axis of the other, or None.

    An elementwise operation would combine every element of one with every element of the other (an
    outer product), which is rarely intended. None also if the axes match by name or along a window.
    Raises AxisConflict if axes of one name differ in length.
    """
    _, left, right = align(left, right)
    for one, other in ((left, right), (right, left)):
        unnamed = _named(one, UNNAMED)
        # an unnamed axis of length 1 is repeated as in numpy: an outer product with it is harmless
        if unnamed is None or unnamed.size == 1 or _named(other, UNNAMED) is not None:
            continue
        for axis in other:
            if axis.size == unnamed.size and axis.name != WINDOW and _named(one, axis.name) is None:
                return axis
    return None


def contracted(
    left: tuple[Axis, ...], right: tuple[Axis, ...]
) -> tuple[Axis, str, tuple[Axis, ...]]:
    """For `left @ right`: returns the summed axis of `left`, the name of its partner in `right`,
    and the axes of the result.

    The summed axis is the last of `left`. Its partner has the same name, else it is the unnamed
    axis (name `""`) or the window, if as long. An unnamed last axis also matches a named axis of
    its length. Raises AxisConflict if no axis fits, if two fit, or if other axes of one name differ
    in length.
    """
    if not left or not right:
        raise AxisConflict(left, right, "`@` needs an axis to sum on both sides", "use `*`")
    last = left[-1]
    same = _named(right, last.name)
    partner: Axis | None
    if same is not None and last.name != UNNAMED:
        partner = same
    else:
        others = [a for a in (_named(right, UNNAMED), _named(right, WINDOW)) if a is not None]
        if last.name == UNNAMED:  # an unnamed axis may also meet the last named one of its length
            others += [a for a in reversed(right) if a.name not in (UNNAMED, WINDOW)]
        fitting = [axis for axis in others if axis.size == last.size]
        # R3: two candidates of that length are an error, not a choice
        if len(fitting) > 1:
            names = " and ".join(f"`{axis.name or '_'}`" for axis in fitting)
            raise AxisConflict(left, right, f"{names} both have {last.size} elements")
        partner = fitting[0] if fitting else None
    if partner is None or partner.size != last.size:
        shown = f"`{last.name}`" if last.name else "the last axis"
        raise AxisConflict(
            left, right, f"nothing on the right fits {shown} with {last.size} elements"
        )
    rest_left = left[:-1]
    # by identity: two axes may be equal
    rest_right = tuple(axis for axis in right if axis is not partner)
    result = list(rest_left)
    for axis in rest_right:
        mine = _named(rest_left, axis.name)
        if mine is None:
            result.append(axis)
        elif mine.size != axis.size:
            raise AxisConflict(
                left, right, f"`{axis.name}` of {mine.size} and {axis.size} elements"
            )
    return last, partner.name, in_order(tuple(result))


RADIAN = parse_unit("rad")


@dataclass(frozen=True, slots=True)
class UnitConflict:
    """Units that do not fit: the name of the operation, the unit of an operand and the unit that
    the operation expects instead.
    """

    operation: str
    found: Unit
    expected: Unit


Ruled = tuple[Unit | None, UnitConflict | None]


def same_unit(left: Unit, right: Unit) -> bool:
    """True if values in the two units can be added: equal scale and dimension. An angle in rad
    counts as dimensionless.
    """
    return left.same_as(right)


def sum_unit(operation: str, left: Unit | None, right: Unit | None) -> Ruled:
    """Unit of a sum, difference, minimum, comparison or choice of two values, and a conflict or
    None.

    An unknown unit (None) fits every unit. `operation` is the name for the conflict's message. With
    a conflict, the unit is None.
    """
    # an unknown unit becomes the other one: checks are gradual (decision 0007)
    if left is None:
        return right, None
    if right is None or same_unit(left, right):
        return left, None
    # the unit of the first operand is the expected one
    return None, UnitConflict(operation, right, left)


def addition_unit(left: Unit | None, right: Unit | None) -> Ruled:
    """Unit of a sum, and a conflict or None. K added to degC gives degC; degC + degC gives degC,
    since half of it is a mean.
    """
    if left is not None and right is not None:
        for point, other in ((left, right), (right, left)):
            if point.offset != 0.0 and same_unit(other, point.difference):
                return point, None
    return sum_unit("+", left, right)


def subtraction_unit(left: Unit | None, right: Unit | None) -> Ruled:
    """Unit of a difference, and a conflict or None: degC - degC is K, degC - K is degC.

    If the second unit is unknown it may be either, so degC minus an unknown unit is unknown.
    """
    if right is not None and right.offset != 0.0 and (left is None or same_unit(left, right)):
        return right.difference, None
    if left is not None and left.offset != 0.0:
        if right is None:
            return None, None
        if same_unit(right, left.difference):
            return left, None
    return sum_unit("-", left, right)


def distance_unit(unit: Unit | None) -> Unit | None:
    """Unit of the difference of two values in this unit: K for values in degC. None if it is
    unknown.
    """
    return None if unit is None else unit.difference


def product_unit(left: Unit | None, right: Unit | None) -> Unit | None:
    """Unit of a product; None if a unit is unknown. A temperature in degC times a dimensionless
    factor stays in degC.
    """
    if left is None or right is None:
        return None
    for point, other in ((left, right), (right, left)):
        if point.offset != 0.0 and _is_number(other):
            return point
    return left.difference * right.difference


def quotient_unit(left: Unit | None, right: Unit | None) -> Unit | None:
    """Unit of a quotient; None if a unit is unknown. A temperature in degC divided by a
    dimensionless factor stays in degC.
    """
    if left is None or right is None:
        return None
    if left.offset != 0.0 and _is_number(right):
        return left
    return left.difference / right.difference


def _is_number(unit: Unit) -> bool:
    return unit.same_as(ONE) and unit.angle == 0


def power_unit(base: Unit | None, exponent: int | Fraction) -> Unit | None:
    """Unit of base^exponent; None if the unit of the base is unknown."""
    return None if base is None else base.power(exponent)


def function_unit(name: str, rule: UnitRule, arguments: tuple[Unit | None, ...]) -> Ruled:
    """Unit of the value of the scalar function `name`, and a conflict or None. `rule` is the unit
    rule of the function, `arguments` are the units of its arguments, None for an unknown one.
    """
    unit = arguments[0]
    match rule:
        case UnitRule.NUMBER | UnitRule.TO_ANGLE | UnitRule.ANGLE:
            expected = RADIAN if rule is UnitRule.ANGLE else ONE
            result = RADIAN if rule is UnitRule.TO_ANGLE else ONE
            # rad counts as 1 here
            for argument in arguments:
                if argument is not None and not same_unit(argument, expected):
                    return result, UnitConflict(name, argument, expected)
            return result, None
        case UnitRule.RATIO_TO_ANGLE:
            _, conflict = sum_unit(name, arguments[0], arguments[1])
            return RADIAN, conflict
        case UnitRule.SAME:
            return unit, None
        case UnitRule.SIGN:
            return ONE, None
        case UnitRule.ROOT:
            return power_unit(unit, Fraction(1, 2)), None


LARGEST_SIZE = 1 << 24
"""Maximum number of scalars in one value: 128 MiB in float64."""
MOST_AXES = 12
LONGEST_NAME = 2000
FARTHEST_SAMPLE = 1 << 24
"""Maximum distance, in samples, between t and a sample that a program reads."""


def broken_axes(axes: tuple[Axis, ...]) -> str | None:
    """The reason why these axes are illegal, a sentence for a message; None if they are legal."""
    if not axes:
        return None
    names = [axis.name for axis in axes]
    if len(set(names)) != len(names):
        return f"{describe_axes(axes)} has an axis twice"
    if any(_is_no_name(name) for name in names):
        return "an axis has no proper name"
    # the window is last (R1): backends rely on the position of the newest sample
    if WINDOW in names[:-1]:
        return f"{describe_axes(axes)} has the window before the end"
    if len(axes) > MOST_AXES or any(axis.size < 1 for axis in axes):
        return f"{describe_axes(axes)} has too many axes or an empty one"
    # checked before memory is allocated: a file may contain any length
    if math.prod(axis.size for axis in axes) > LARGEST_SIZE:
        return f"{describe_axes(axes)} has more than {LARGEST_SIZE} elements"
    return None


def broken_rule(node: Node, operands: tuple[Type, ...], sources: AxesOfSources) -> str | None:
    """The reason why a node is illegal for operands of these types, a sentence for a message; None
    if it is legal. `sources` has the axes of the signals, parameters and states that it may read.

    Units are not checked here: the front end has done so.
    """
    type, axes = node.type, node.type.axes
    reason = broken_axes(axes) or _wrong_count(node, operands)
    if reason is not None:
        return reason
    match node.op:
        case ops.Constant(name=name) if name and _is_no_name(name):
            return "a constant has no proper name"
        case ops.Constant(values):
            # no infinite constants: JSON has none; a model that needs one divides by 0
            if len(values) != type.size or not all(math.isfinite(value) for value in values):
                return f"{len(values)} numbers for {describe_axes(axes)}, or one is not finite"
            return _real(type)
        case ops.ReadParameter(name):
            return _from(f"parameter `{name}`", sources.parameters.get(name), type)
        case ops.ReadState(name):
            return _from(f"state `{name}`", sources.states.get(name), type)
        case ops.ReadSignal(name, first, last) | ops.ReadLog(name, first, last):
            return _read(sources.signals.get(name), name, first, last, type)
        # only graphs that training derives may read such values
        case ops.ReadTraining():
            return "a program reads no value of training"
        case ops.Dropout(rate) if not 0 <= rate < 1:
            return f"a share of {rate} cannot be left out"
        case ops.Named(name) if _is_no_name(name):
            return "a value is named by no proper name"
        case ops.Named():
            fits = operands[0].kind == type.kind
            return _elementwise(type, operands) or (None if fits else "a name changes no kind")
        case ops.Apply(function) if function not in SCALAR_FUNCTIONS:
            return f"there is no function `{function}`"
        case ops.Compare():
            reason = _elementwise(type, operands) or _real(*operands)
            return reason or (None if type.kind == "bool" else "a comparison is a bool")
        case ops.Select():
            if operands[0].kind != "bool":
                return "the condition is not a bool"
            return _elementwise(type, operands) or _real(type, *operands[1:])
        case ops.Elementwise():
            return _elementwise(type, operands) or _real(type, *operands)
        case ops.Broadcast():
            fits = set(operands[0].axes) <= set(axes) and operands[0].kind == type.kind
            return None if fits else f"{describe_axes(operands[0].axes)} does not fit in the result"
        case ops.Reshape():
            fits = operands[0].size == type.size and operands[0].kind == type.kind
            return None if fits else f"{describe_axes(operands[0].axes)} has another size"
        case ops.Slice(axis, start, stop):
            return _sliced(operands[0], axis, start, stop, type)
        case ops.Concat(axis):
            return _joined(operands, axis, type)
        case ops.Sum(axis):
            rest = tuple(a for a in operands[0].axes if a.name != axis)
            fits = operands[0].axis(axis) is not None and rest == axes
            return _real(type, *operands) or (None if fits else f"not the sum over `{axis}`")
        case ops.Contract(axis):
            return _real(type, *operands) or _contracted(operands[0], operands[1], axis, axes)
        case ops.Window(state):
            return _windowed(sources.states.get(state), operands[0], state, type)
        case _:
            assert_never(node.op)


@dataclass(frozen=True, slots=True)
class AxesOfSources:
    """The axes of one sample of the signals, parameters and states that a graph may read,
    by name.
    """

    signals: Mapping[str, tuple[Axis, ...]]
    parameters: Mapping[str, tuple[Axis, ...]]
    states: Mapping[str, tuple[Axis, ...]]


def _is_no_name(name: str) -> bool:
    return len(name) > LONGEST_NAME or not name.isprintable()


def _wrong_count(node: Node, operands: tuple[Type, ...]) -> str | None:
    match node.op:
        case ops.Apply(function):
            row = SCALAR_FUNCTIONS.get(function)
            count = row.arity if row is not None else len(operands)
        case ops.Concat():
            count = max(len(operands), 1)
        case _:
            count = node.op.arity
    return None if len(operands) == count else f"{len(operands)} operands, not {count}"


def _real(*types: Type) -> str | None:
    for type in types:
        if type.kind != "real":
            return "a bool where a number belongs"
    return None


def _elementwise(type: Type, operands: tuple[Type, ...]) -> str | None:
    for operand in operands:
        if operand.axes != type.axes:
            return f"an operand has axes {describe_axes(operand.axes)}"
    return None


def _from(what: str, axes: tuple[Axis, ...] | None, type: Type) -> str | None:
    if axes is None:
        return f"there is no {what}"
    if axes != type.axes:
        return f"{what} has axes {describe_axes(axes)}"
    return _real(type)


def _read(
    axes: tuple[Axis, ...] | None, name: str, first: int, last: int, type: Type
) -> str | None:
    if axes is None:
        return f"there is no signal `{name}`"
    if not -FARTHEST_SAMPLE <= first <= last <= FARTHEST_SAMPLE:
        return f"samples {first} … {last} are no window"
    # a window of length 1 has a window axis; a single sample has none
    window = (Axis(WINDOW, last - first + 1),) if type.window is not None else ()
    if not window and first != last:
        return "several samples need a window axis"
    return _from(f"signal `{name}`", (*axes, *window), type)


def _sliced(operand: Type, axis: str, start: int, stop: int, type: Type) -> str | None:
    whole = operand.axis(axis)
    if whole is None or not 0 <= start < stop <= whole.size:
        return f"`{axis}` {start}:{stop} is no part of {describe_axes(operand.axes)}"
    part = tuple(Axis(axis, stop - start) if a.name == axis else a for a in operand.axes)
    return None if part == type.axes and operand.kind == type.kind else "not the slice's axes"


def _joined(operands: tuple[Type, ...], axis: str, type: Type) -> str | None:
    parts = [operand.axis(axis) for operand in operands]
    size = sum(part.size for part in parts if part is not None)
    for operand, part in zip(operands, parts, strict=True):
        longer = tuple(Axis(axis, size) if a.name == axis else a for a in operand.axes)
        if part is None or longer != type.axes or operand.kind != type.kind:
            return f"{describe_axes(operand.axes)} does not join along `{axis or '_'}`"
    return None


def _contracted(left: Type, right: Type, axis: str, axes: tuple[Axis, ...]) -> str | None:
    mine, partner = left.axis(axis), right.axis(axis)
    if mine is None or mine != partner:
        return f"`{axis or '_'}` is not an axis of equal length on both sides"
    rest = {a for a in (*left.axes, *right.axes) if a.name != axis}
    return None if rest == set(axes) else "not the axes of both without the contracted one"


def _windowed(state: tuple[Axis, ...] | None, newest: Type, name: str, type: Type) -> str | None:
    if state is None or not state or state[-1].name != WINDOW:
        return f"there is no buffer `{name}`"
    grown = (*newest.axes, Axis(WINDOW, state[-1].size + 1))
    if newest.axes != state[:-1] or type.axes != grown:
        return f"buffer `{name}` has axes {describe_axes(state)}"
    return _real(type, newest)
