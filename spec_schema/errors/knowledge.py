"""E0352, E0964-E0969: what a spec knows of learned values beside the data."""

from collections.abc import Sequence

from spec_schema.diagnostics.diagnostic import Diagnostic, error
from spec_schema.diagnostics.source import Span


def narrow_prior(std: str, span: Span) -> Diagnostic:
    """E0964: a prior without width."""
    message = f"the standard deviation of a prior must be above 0, not {std}"
    repair = "hold a value that is known exactly with `learn: false`"
    return error("E0964", span, message, "no width", help=repair)


def prior_of_a_constant(span: Span) -> Diagnostic:
    """E0965: a prior of a parameter that no training changes."""
    message = "a prior says nothing of a parameter with `learn: false`: it keeps its value"
    repair = "leave `prior:` or `learn: false` out"
    return error("E0965", span, message, "of a value that is not learned", help=repair)


def no_array_to_group(why: str, span: Span | None) -> Diagnostic:
    """E0967: `group` of something whose slices cannot be taken to 0."""
    message = f"`group` takes an array that is learned without bounds: {why}"
    repair = "write `group(f.weight, over=DIM)` of an array of a layer, or of a parameter"
    return error("E0967", span, message, "not such an array", help=repair)


def group_over_nothing(dims: Sequence[str], span: Span) -> Diagnostic:
    """E0352: a `group` that does not say what its slices are."""
    message = "`group` needs `over=`, the dim whose slices it takes to 0 as a whole"
    repair = f"the array has {', '.join(f'`over={dim}`' for dim in dims)}"
    if not dims:
        repair = "a single number has no slices: write `l1(…)`"
    return error("E0352", span, message, "slices of what?", help=repair)


def several_groups(name: str, span: Span | None) -> Diagnostic:
    """E0968: slices of one array that share numbers."""
    message = f"`{name}` has a `group` already: slices that overlap have no common step to 0"
    repair = "keep one of them; `l1` of the same array may stand beside it"
    return error("E0968", span, message, "a second `group` of the array", help=repair)
