"""E0960-E0963, E1223, W0746: models that fixed point cannot export or computes differently."""

from collections.abc import Sequence

from spec_schema.diagnostics.diagnostic import Diagnostic, error, warning
from spec_schema.diagnostics.source import Span


def range_needed(what: str, name: str, span: Span | None) -> Diagnostic:
    """E0960: a signal has no finite range, which fixed point needs."""
    message = f"fixed point needs the range of {what} `{name}`"
    repair = "declare the range that it has in operation: `range: [low, high]`"
    return error("E0960", span, message, "no finite `range:`", help=repair)


def not_in_fixed_point(what: str, span: Span | None, why: str) -> Diagnostic:
    """E0961: a value has no bounds, needs too large a table or more bits than integers have."""
    message = f"{what} cannot be computed in fixed point: it {why}"
    repair = "bound what it depends on with `range:` or `clip`, or export `dtype: float32`"
    return error("E0961", span, message, "not in integers", help=repair)


def fixed_point_option(option: str, span: Span) -> Diagnostic:
    """E0962: an option of generated C has no meaning in fixed point."""
    message = f"`{option}` has no meaning for C in fixed point"
    repair = f"leave `{option}:` out: numbers are written into the code"
    return error("E0962", span, message, "beside `dtype: q15` or `q31`", help=repair)


def no_integer_slopes(span: Span) -> Diagnostic:
    """E0963: a Jacobian is requested in fixed point, where its entries have no proved bounds."""
    message = "C in fixed point has no Jacobian"
    repair = "export `dtype: float32` for what linearises the model"
    return error("E0963", span, message, "`with:` beside `dtype: q15` or `q31`", help=repair)


def no_integer_node(span: Span) -> Diagnostic:
    """E1223: a ROS 2 node is requested for C in fixed point, whose values are words."""
    message = "C in fixed point has no node of ROS 2"
    repair = "export `dtype: float32` for the node: its messages are real numbers"
    return error("E1223", span, message, "`with:` beside `dtype: q15` or `q31`", help=repair)


def saturates_all_the_same(names: Sequence[str], span: Span) -> Diagnostic:
    """W0746: fixed point saturates states that other engines only flag."""
    listed = ", ".join(f"`{name}`" for name in names)
    plural = len(names) > 1
    message = (
        f"fixed point keeps the state{'s' if plural else ''} {listed} inside "
        f"{'their ranges' if plural else 'its range'}, unlike the model"
    )
    label = "`on_range: flag` reports what leaves the range, and integers have no room beyond it"
    repair = "write `on_range: saturate`: simulation, training and every export do the same then"
    return warning("W0746", span, message, label, help=repair)
