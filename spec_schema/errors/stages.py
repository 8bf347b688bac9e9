"""E0940-E0949: curricula and optimisers of training stages."""

from spec_schema.diagnostics import Diagnostic
from spec_schema.source import Span


def misfitting_curriculum(problem: str, span: Span) -> Diagnostic:
    """E0940: a curriculum that does not lead to the horizon of its rollout."""
    return Diagnostic(
        "E0940",
        "error",
        f"the curriculum does not lead to the horizon: {problem}",
        span,
        help="`{horizon: 50, curriculum: {20: 5, 40: 20}}` trains on 5 samples up to epoch 20, on "
        "20 up to epoch 40, then on 50",
    )


def curriculum_outside_training(span: Span) -> Diagnostic:
    """E0941: a curriculum where nothing is trained."""
    return Diagnostic(
        "E0941",
        "error",
        "a curriculum belongs to a stage of `train:`",
        span,
        "nothing is trained here",
        help="leave it out: a metric is measured over the whole horizon",
    )
