"""W0744, E0930-E0939, E0985: second-order training, slopes, what they say of learned parameters."""

from collections.abc import Mapping, Sequence

from compiler.ir.slopes import LARGEST_SLOPE
from spec_schema.diagnostics.diagnostic import Diagnostic, error, warning
from spec_schema.diagnostics.source import Span

_SHOWN = 6
"""Numbers of a change that are named, the largest first."""


def no_sum_of_squares(
    loss: str, what: str, span: Span | None, stage: str, *, is_penalty: bool
) -> Diagnostic:
    """E0930: a loss that is no sum of squares, in a stage of levenberg_marquardt."""
    message = f"stage `{stage}` cannot minimise the loss `{loss}`: {what} is no sum of squares"
    repair = (
        f"write it with mse, l2 or huber, give the stage `losses: {{{loss}: 0}}`, or take "
        "another optimizer"
    )
    if is_penalty:
        repair = (
            "write l1 of a learned array without bounds, with factors outside: `2 * l1(f.weight)`; "
            "or take l2, or another optimizer"
        )
    label = "levenberg_marquardt takes mse, l2, huber, and l1 and group of learned arrays"
    return error("E0930", span, message, label, help=repair)


def not_of_second_order(key: str, reason: str, span: Span) -> Diagnostic:
    """E0931: a key of a stage that levenberg_marquardt has no use for."""
    message = f"levenberg_marquardt takes no `{key}:`: {reason}"
    repair = f"leave `{key}:` out"
    return error("E0931", span, message, f"with `{key}:` in the same stage", help=repair)


def no_finite_slope(
    stage: str, epoch: int, parameters: Sequence[str], span: Span | None
) -> Diagnostic:
    """E0985: a loss that is finite where its slope is infinite or NaN."""
    where = f" in {' and '.join(f'`{name}`' for name in parameters)}" if parameters else ""
    message = f"stage `{stage}` ends in epoch {epoch}: the loss is finite, its slope{where} is not"
    notes = ("the best weights so far are kept",)
    repair = (
        "roots, logarithms and powers are infinitely steep at 0: keep their arguments away "
        "from it (`sqrt(x + 1e-6)`), or begin elsewhere"
    )
    return error("E0985", span, message, "no finite slope here", notes=notes, help=repair)


def left_out(stage: str, span: Span | None) -> Diagnostic:
    """W0744: infinite slopes in training, which have no share in its steps."""
    message = f"in stage `{stage}` a scored value has an infinite slope in a learned number"
    notes = (
        "levenberg_marquardt leaves out such values, other optimizers the batches with them",
        "the losses count them all the same",
        f"slopes above {LARGEST_SLOPE:g} in multiples of the `scale` of a number count as infinite",
    )
    repair = (
        "roots, logarithms and powers are infinitely steep at 0: keep their arguments away "
        "from it (`sqrt(x + 1e-6)`); of rollouts that grow without bound shorten the horizon, "
        "and give tiny numbers a `scale`"
    )
    return warning("W0744", span, message, "no step is made of it", notes=notes, help=repair)


def not_identifiable(
    changes: Sequence[Mapping[str, float]],
    concerned: Mapping[str, tuple[int, int]],
    black_boxes: Sequence[str],
    span: Span | None,
) -> Diagnostic:
    """W0930: learned numbers that can change together without a change of any residual."""
    # of each parameter: how many of its numbers are in the changes, and how many it has
    named = " and ".join(
        f"`{name}`" if size == 1 else f"{count} of the {size} numbers of `{name}`"
        for name, (count, size) in concerned.items()
    )
    others = f" with {' and '.join(f'`{name}`' for name in black_boxes)}" if black_boxes else ""
    alone = not others and all(len(change) == 1 for change in changes)
    many = sum(count for count, _ in concerned.values()) > 1
    verb = ("do not show" if many else "does not show") if alone else "show only in combination"
    if not alone and not many:
        verb = "shows only in combination"
    first = sorted(changes[0].items(), key=lambda item: -abs(item[1]))
    moves = ", ".join(f"{name} {factor:+.3g}" for name, factor in first[:_SHOWN])
    if len(first) > _SHOWN:
        moves += f" and {len(first) - _SHOWN} smaller ones"
    moves += others and f"{others} in its place"
    said = (
        f"this change leaves every residual as it is: {moves}"
        if len(changes) == 1
        else f"{len(changes)} changes leave every residual as it is, one of them: {moves}"
    )
    message = f"{named} {verb}{others} in the training data"
    repair = (
        "hold some at known values with `learn: false`, shorten windows, or record data that "
        "excite them"
    )
    return warning("W0930", span, message, "not identifiable", notes=(said,), help=repair)
