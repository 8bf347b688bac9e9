"""W0936-W0938: what the course of a training says of its losses, parameters and kept epochs."""

from collections.abc import Sequence
from dataclasses import dataclass

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


@dataclass(frozen=True, slots=True)
class Decided:
    """A stage, and what decides which of its epochs is kept."""

    stage: str
    rollouts: int
    watched: str
    span: Span | None

    @property
    def over(self) -> str:
        """The rollouts in words."""
        count = "the only rollout" if self.rollouts == 1 else f"{self.rollouts} rollouts"
        return f"{count} of `{self.watched}`"

    @property
    def repair(self) -> str:
        """Other rows of validation, and more of them."""
        shorter = "a shorter `rollout.horizon`, or " if self.rollouts < _FEW else ""
        return f"{shorter}a `split:` that spreads `val` over the records (`by: block`)"


def kept_on_the_way(
    decided: Decided, epoch: int, epochs: int, then: float, at_last: float
) -> Diagnostic:
    """W0938: a least-squares stage that keeps weights from the middle of its path."""
    message = (
        f"stage `{decided.stage}` keeps epoch {epoch} of {epochs}, the best over {decided.over}: "
        f"the loss of training fell from {then:.3g} to {at_last:.3g} after it"
    )
    label = "these rollouts decide"
    return warning("W0938", decided.span, message, label, help=decided.repair)


def watched_far_above(decided: Decided, monitor: float, total: float) -> Diagnostic:
    """W0938: a monitor far above what a stage reaches on its training rows."""
    message = (
        f"stage `{decided.stage}`: the loss over {decided.over} is {monitor:.3g}, "
        f"over those of training {total:.3g}"
    )
    label = "the two sets differ"
    return warning("W0938", decided.span, message, label, help=decided.repair)
