"""Aligns the axes of two operands by name and broadcasts missing ones (rule R3)."""

from __future__ import annotations

from compiler.ir.types import UNNAMED, WINDOW, Axis, describe_axes, in_order


class AxisConflict(Exception):  # noqa: N818  (a finding to report, not a failure)
    """Two operands whose axes do not fit. `reason` is a clause of the message, `hint` a repair."""

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
    """Matches an axis of an operand without window to the window of the other operand.

    The chosen axis is renamed to the window. It is the unnamed axis, or else the last named axis
    that the other operand lacks, if it has the length of the window. Example: `W * delta.past(30)`.
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
    """Returns the axes of an elementwise result, and the operands' axes renamed to fit in them.

    Renaming preserves the order of elements, except that a new window axis moves to the end. The
    caller then broadcasts both operands. Raises AxisConflict.
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
    """The named axis of one operand that is as long as the unnamed axis of the other.

    An elementwise operation would form all pairs of their elements (an outer product), which is
    rarely intended. Returns None if the two match by name or along a window. Raises AxisConflict.
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
    """For `left @ right`: the summed axes of `left` and `right`, and the axes of the result.

    Returns the last axis of `left`, the name of its partner in `right`, and the result. A window is
    always the last axis; the name of an unnamed axis is empty. The partner has the same name, else
    it is the unnamed axis or the window of the same length. An unnamed last axis also matches a
    named axis of its length. Raises AxisConflict if no axis fits, if two fit, or if other axes of
    one name differ in length.
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
