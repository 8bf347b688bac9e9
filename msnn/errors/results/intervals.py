"""E1047-E1049: prediction intervals that cannot be made."""

from collections.abc import Sequence

from spec_schema.diagnostics.diagnostic import Diagnostic, error


def no_covariance(why: str) -> Diagnostic:
    """E1047: intervals of weights whose uncertainty is not known."""
    message = f"there are no prediction intervals: {why}"
    repair = "take the weights of a whole training, with the folder of its run or its result"
    return error("E1047", None, message, help=repair)


def no_training_rows(output: str | None, why: str) -> Diagnostic:
    """E1048: intervals without rows that tell how large errors are."""
    of = "" if output is None else f" of `{output}`"
    message = f"there are no prediction intervals{of}: {why}"
    repair = "how large errors are is measured on the set `train`: data without it do not tell"
    return error("E1048", None, message, help=repair)


def nothing_to_band(outputs: Sequence[str]) -> Diagnostic:
    """E1049: intervals of outputs that no measurement is compared with."""
    listed = ", ".join(f"`{name}`" for name in outputs)
    message = f"no output of {listed} predicts a signal: what it errs by is not known"
    repair = 'say what an output predicts: `y: {expr: …, predicts: "x[t+1]"}`'
    return error("E1049", None, message, help=repair)
