"""E0973-E0977: comparisons of models: grids, what is held out, what is compared."""

from collections.abc import Sequence

from spec_schema.diagnostics.diagnostic import Diagnostic, error


def malformed_grid(text: str) -> Diagnostic:
    """E0973: an axis of a grid that is no path and values."""
    message = f"`{text}` is no path, `=` and values"
    repair = "write `--grid layers.h.fir.window=5,10,20`; lists and mappings stand in brackets"
    return error("E0973", None, message, help=repair)


def nothing_held_out(name: str, sets: Sequence[str]) -> Diagnostic:
    """E0974: a comparison on a set that has no rows."""
    message = f"models are compared on rows that none has seen, and the set `{name}` has none"
    repair = (
        "add a split, such as `--set 'data.split={by: fraction, train: 0.7, val: 0.3}'`, or "
        "train every fold: `--folds --set 'data.split={by: kfold, k: 5}'`"
    )
    notes = (f"sets with rows: {', '.join(sets)}",)
    return error("E0974", None, message, notes=notes, help=repair)


def nothing_in_common(
    first: str, of_first: Sequence[str], other: str, of_other: Sequence[str]
) -> Diagnostic:
    """E0975: models of which nothing alike is measured."""
    message = f"`{first}` and `{other}` have no metric in common"
    notes = tuple(
        f"`{name}` measures {'; '.join(ways) or 'nothing'}"
        for name, ways in ((first, of_first), (other, of_other))
    )
    repair = (
        "give their `validate` sections an entry with the same output, unit and rollout; a signal "
        "that one feeds back (`closing x`) and the other has as a target belongs under `inputs:` "
        "in both"
    )
    return error("E0975", None, message, notes=notes, help=repair)


def unknown_criterion(text: str, known: Sequence[str]) -> Diagnostic:
    """E0976: a comparison by what was not measured of every model."""
    message = f"`{text}` was not measured of every model"
    notes = (f"measured: {', '.join(known)}",)
    return error("E0976", None, message, notes=notes, help="name one of these with `--by`")


def killed_again(label: str, times: str) -> Diagnostic:
    """E0977: a training of a comparison whose process was killed, also when it was tried again."""
    message = f"the training of `{label}` was killed {times}"
    repair = "the system may be out of memory: try `--jobs 1`, fewer rows or a smaller `batch`"
    return error("E0977", None, message, help=repair)
