"""E0853, E0870, W0809, W0842, W1004, W1005: results of validations, and reports of runs."""

from collections.abc import Sequence
from dataclasses import dataclass

from spec_schema.diagnostics.diagnostic import Diagnostic, error, warning
from spec_schema.diagnostics.source import Span


@dataclass(frozen=True, slots=True)
class Outside:
    """An input that leaves the range of training, in a share of the rows, 0 to 1."""

    signal: str
    share: float
    low: float
    high: float

    @property
    def text(self) -> str:
        """In words, with the range."""
        return f"`{self.signal}` in {self.share:.1%} of them ({self.low:.4g} … {self.high:.4g})"


def extrapolates(name: str, outside: Sequence[Outside]) -> Diagnostic:
    """W1004: inputs of scored rows are outside the range of the training data."""
    if len(outside) == 1:
        (one,) = outside
        message = (
            f"in {one.share:.1%} of the rows scored in `{name}` the input `{one.signal}` is "
            f"outside of the {one.low:.4g} … {one.high:.4g} that was trained on: there the model "
            "extrapolates"
        )
    else:
        listed = ", ".join(each.text for each in outside)
        message = (
            f"in rows scored in `{name}` inputs are outside of what was trained on: {listed}; "
            "there the model extrapolates"
        )
    repair = (
        "train on records that reach as far, or choose the sets by `split` under `data:` so that "
        "each has its share"
    )
    return warning("W1004", None, message, help=repair)


def worse_than_mean(*, of: str, rmse: str, mean: str, rows: str, simulated: str) -> Diagnostic:
    """W0842: the errors of an output are larger than those of predicting its mean."""
    message = (
        f"`{of}` is worse than predicting the mean: rmse {rmse} ({simulated}), "
        f"the mean of the {rows} rows has {mean}"
    )
    repair = (
        "train longer or from other initial values, or look for a delay or an input that lacks: "
        "`msnn data`"
    )
    return warning("W0842", None, message, help=repair)


def of_another_fold(run: str, trained: int, held_out: int) -> Diagnostic:
    """W1005: a model of one fold is measured on rows of another fold, which it was trained on."""
    message = (
        f"the weights in {run} are those of fold {trained}, which was trained on what fold "
        f"{held_out} holds out: errors on these rows are too small"
    )
    return warning("W1005", None, message, help=f"measure that run: `msnn validate {run}`")


def broken_limit(
    *,
    of: str,
    metric: str,
    value: str,
    limit: str,
    simulated: str,
    data: str,
    scored: int,
    span: Span | None,
) -> Diagnostic:
    """E0870: a metric violates the limit of its `validate` entry, or is unknown."""
    message = f"{metric} of `{of}` is {value}, and the limit is {limit}"
    repair = "train again, or change the limit where the model is as good as it has to be"
    notes = (f"measured on `{data}`: {simulated}",)
    if not scored:
        message = f"{metric} of `{of}` is not known, and the limit is {limit}"
        notes = (f"its rollouts reach no measured value of `{data}`: {simulated}",)
        repair = (
            "choose a `rollout:` that is as long as the rows from one measured value to the next, "
            "`rollout: record`, or rows with values"
        )
    return error("E0870", span, message, "does not hold", notes=notes, help=repair)


def not_verification(file: str) -> Diagnostic:
    """E0853: a file of results was not written by `msnn verify`."""
    message = f"{file} is not what `msnn verify --format json` writes"
    repair = "write it: `msnn verify build/export/c --format json -o verification.json`"
    return error("E0853", None, message, help=repair)


def no_part(part: str, reason: str, repair: str | None = None) -> Diagnostic:
    """W0809: a part of a report is missing."""
    message = f"the report has no {part}: {reason}"
    usual = "what it has is right all the same; mend the reason and write it again"
    return warning("W0809", None, message, help=repair or usual)
