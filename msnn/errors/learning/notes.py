"""W0936-W0938: what the course of a training says of its losses, parameters and kept epochs."""

from collections.abc import Sequence

from spec_schema.diagnostics.diagnostic import Diagnostic, warning
from spec_schema.diagnostics.source import Span

_FEW = 20
"""Rollouts of validation below which a shorter horizon makes more of them."""


def decides_alone(
    loss: str, share: float, stage: str, others: Sequence[str], span: Span | None
) -> Diagnostic:
    """W0936: a loss beside which the others do not count."""
    listed = ", ".join(f"`{name}`" for name in others)
    message = (
        f"`{loss}` is {min(100 * share, 99.99):.4g} % of the total of stage `{stage}`: "
        f"{listed} hardly count{'s' if len(others) == 1 else ''}"
    )
    repair = (
        f"larger weights of the others, as 1/variance of their target: `losses: {{{others[0]}: "
        "WEIGHT}` of the stage"
    )
    return warning("W0936", span, message, "from its first epoch to its last", help=repair)


def hardly_moved(names: Sequence[str], span: Span | None) -> Diagnostic:
    """W0937: parameters that a training by steps of a rate has left where they were."""
    listed = ", ".join(f"`{name}`" for name in names)
    message = f"{listed} moved by less than 1 % of {'its' if len(names) == 1 else 'their'} scale"
    repair = (
        "if that is not where it belongs: `scale: data` of the parameter, a larger `lr`, more "
        "epochs, or `optimizer: levenberg_marquardt`"
    )
    return warning("W0937", span, message, "a step is a part of `scale:`", help=repair)


def validation_decided(
    *,
    stage: str,
    rollouts: int,
    watched: str,
    epoch: int,
    epochs: int,
    is_on_the_way: bool,
    value: float,
    last: float,
    span: Span | None,
) -> Diagnostic:
    """W0938: weights that validation chose far from what the training rows say."""
    over = f"{'the only rollout' if rollouts == 1 else f'{rollouts} rollouts'} of `{watched}`"
    # an epoch of a least-squares stage in the middle of its path, or a monitor far above
    if is_on_the_way:
        message = (
            f"stage `{stage}` keeps epoch {epoch} of {epochs}, the best over {over}: "
            f"the loss of training fell from {value:.3g} to {last:.3g} after it"
        )
    else:
        message = (
            f"stage `{stage}`: the loss over {over} is {value:.3g} in epoch {epoch}, the best; "
            f"over those of training it is {last:.3g} in epoch {epochs}, the last"
        )
    shorter = "a shorter `rollout.horizon`, or " if rollouts < _FEW else ""
    repair = f"{shorter}a `split:` that spreads `val` over the records (`by: block`)"
    return warning("W0938", span, message, "these rollouts decide", help=repair)
