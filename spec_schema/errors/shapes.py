"""E04xx, E1145: dimensions and shapes."""

from spec_schema.diagnostics.diagnostic import Diagnostic, error, warning
from spec_schema.diagnostics.source import Span


def axes_differ(
    operation: str,
    left: str,
    right: str,
    reason: str,
    span: Span,
    left_span: Span,
    right_span: Span,
    repair: str | None,
) -> Diagnostic:
    """E0401: operands whose axes cannot meet."""
    return error(
        "E0401",
        span,
        f"`{operation}` cannot align its operands: {reason}",
        "here",
        secondary=((left_span, f"this is {left}"), (right_span, f"this is {right}")),
        notes=("operands are aligned by the names of their axes",),
        help=repair,
    )


def twin_axes(
    operation: str,
    name: str,
    size: int,
    span: Span,
    left: tuple[Span, str],
    right: tuple[Span, str],
) -> Diagnostic:
    """W0401: a named and an unnamed axis of one length, of which an operation makes all pairs."""
    return warning(
        "W0401",
        span,
        f"`{operation}` pairs each element of `{name}` with each of an unnamed axis as long",
        f"{size}×{size} values",
        secondary=tuple((place, f"this is {axes}") for place, axes in (left, right)),
        notes=("operands are aligned by the names of their axes",),
        help=f"element by element: name the other, as a constant with `dims: {name}`; "
        "all pairs: say `outer(a, b)`, or name both",
    )


def wrong_axes(
    what: str,
    wanted: str,
    found: str,
    span: Span,
    repair: str | None = None,
    operand: str | None = None,
) -> Diagnostic:
    """E0402: a value with other axes than its place needs."""
    # `operand` names the axes of the part of the value that is underlined, where that is one
    message = f"{what} must be {wanted}, not {found}"
    return error("E0402", span, message, f"this is {operand or found}", help=repair)


def window_needed(layer: str, span: Span) -> Diagnostic:
    """E0403: a layer that works on a time window and got one sample."""
    repair = f"give the layer `window: 5`, or call `{layer}(x.past(5))`"
    return error("E0403", span, f"`{layer}` needs a time window", "this is one sample", help=repair)


def layer_called_differently(layer: str, before: str, now: str, span: Span) -> Diagnostic:
    """E0404: a layer called with two different shapes; its weights are shared."""
    message = f"`{layer}` is called with {now} here and with {before} elsewhere"
    notes = ("one layer called twice shares its weights",)
    repair = "declare a second layer"
    return error("E0404", span, message, "another shape", notes=notes, help=repair)


def too_large(axes: str, most: int, span: Span) -> Diagnostic:
    """E1145: a value of more elements than memory would hold along a record."""
    message = f"{axes} has more than {most:,} elements"
    repair = "take shorter dims or a shorter window, or reduce a factor first: `sum(x) * sum(u)`"
    return error("E1145", span, message, "too large to be one value", help=repair)


def unknown_dimension(name: str, span: Span) -> Diagnostic:
    """E0405: a dimension that `dims:` does not list."""
    message = f"unknown dimension `{name}`"
    return error("E0405", span, message, "not in `dims:`", help=f"add it: `dims: {{{name}: 3}}`")


def no_such_element(element: str, axes: str, among: str, span: Span) -> Diagnostic:
    """E0408: an element that no axis of the value has."""
    message = f"`part` finds no element `{element}` in a value that is {axes}"
    return error("E0408", span, message, "no such element", help=among)


def no_such_axis(function: str, axis: str, axes: str, span: Span) -> Diagnostic:
    """E0406: an axis that the value does not have."""
    return error("E0406", span, f"`{function}` over `{axis}`: the value is {axes}", "no such axis")


def unfit_parameter(
    layer: str, parameter: str, wanted: str, found: str, span: Span, declared: Span
) -> Diagnostic:
    """E0407: a parameter with other axes than the array of the layer that it is named for."""
    return error(
        "E0407",
        span,
        f"`{layer}` needs an array of {wanted}, and `{parameter}` has {found}",
        f"`{layer}` takes it from here",
        secondary=((declared, f"declared with {found}"),),
        # orientation decides which array fits, and nothing in the numbers shows it
        notes=("axes in this order; samples of a window, oldest first, are the last",),
        help=f"change `dims:` of `{parameter}`; `any` is whichever dim has that size",
    )
