"""E0854-E0864, E0973-E0977: comparisons and sweeps: grids, draws, studies, clusters."""

from collections.abc import Sequence

from spec_schema.diagnostics.diagnostic import Diagnostic, error


def malformed_grid(text: str) -> Diagnostic:
    """E0973: an axis of a grid has another form than path, `=` and values."""
    message = f"`{text}` is no path, `=` and values"
    repair = "write `--grid layers.h.fir.window=5,10,20`; lists and mappings stand in brackets"
    return error("E0973", None, message, help=repair)


def nothing_held_out(name: str, sets: Sequence[str]) -> Diagnostic:
    """E0974: the set on which models are compared has no rows."""
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
    """E0975: the models to compare have no common metric."""
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
    """E0976: the criterion was not measured for every model."""
    message = f"`{text}` was not measured of every model"
    notes = (f"measured: {', '.join(known)}",)
    return error("E0976", None, message, notes=notes, help="name one of these with `--by`")


def killed_again(label: str, times: str) -> Diagnostic:
    """E0977: the process of a training was killed repeatedly."""
    message = f"the training of `{label}` was killed {times}"
    repair = "the system may be out of memory: try `--jobs 1`, fewer rows or a smaller `batch`"
    return error("E0977", None, message, help=repair)


def malformed_draw(text: str) -> Diagnostic:
    """E0860: a distribution to draw values from is malformed or unknown."""
    message = f"`{text}` is no path, `=` and what the value is drawn from"
    repair = (
        "write `KEY=uniform(0.5, 2)`, `KEY=log(1e-3, 1e-1)`, `KEY=integer(1, 20)`, each with a "
        "unit behind it where the value has one, or `KEY=choice(rk4, euler)`"
    )
    return error("E0860", None, message, help=repair)


def wrong_bounds(text: str, why: str) -> Diagnostic:
    """E0861: no value can be drawn between the bounds of a distribution."""
    message = f"nothing can be drawn from `{text}`: {why}"
    repair = (
        "give two finite bounds, the smaller first: `KEY=uniform(0.5, 2)`; `log` needs both > 0"
    )
    return error("E0861", None, message, help=repair)


def swept_twice(path: str) -> Diagnostic:
    """E0862: two options sweep the same value of a spec."""
    message = f"`{path}` is swept twice"
    repair = "leave it to one `--grid` or `--draw`"
    return error("E0862", None, message, help=repair)


def set_and_swept(path: str, swept: str) -> Diagnostic:
    """E0857: `--set` gives a value, or a part of one, that a sweep varies."""
    message = f"`--set` gives `{path}` one value, and `{swept}` is swept"
    repair = f"leave out `--set {path}=…`: every model would replace its value"
    return error("E0857", None, message, help=repair)


def nothing_drawn(count: int) -> Diagnostic:
    """E0863: `--draws` is given, but no value to draw."""
    message = f"{count} draws are asked for, and no value is drawn"
    repair = "say which: `--draw 'parameters.k.init=log(1, 100)'`, or leave out `--draws`"
    return error("E0863", None, message, help=repair)


def unusable_cluster(address: str, why: str) -> Diagnostic:
    """E0864: a Ray cluster cannot be used."""
    message = f"trainings cannot run on the Ray cluster `{address}`: {why}"
    repair = (
        "give the address that `ray start --head` prints, `auto` on a node of the cluster, or "
        "`local` to try it here; all nodes need the same msnn, Python and Ray"
    )
    return error("E0864", None, message, help=repair)


def nothing_proposed() -> Diagnostic:
    """E0854: `--optuna` is given, but no value to choose."""
    message = "Optuna is to propose values, and nothing says of what"
    repair = "say it: `--draw 'parameters.k.init=log(1, 100)'`; `choice(a, b)` for words"
    return error("E0854", None, message, help=repair)


def grid_of_a_search(path: str) -> Diagnostic:
    """E0855: `--grid` and `--optuna` are given together."""
    message = f"`--grid {path}=…` trains every choice, and `--optuna` the promising ones"
    repair = f"leave the choice to the search, `--draw '{path}=choice(…)'`, or sweep without it"
    return error("E0855", None, message, help=repair)


def study_in_memory(storage: str) -> Diagnostic:
    """E0859: an Optuna storage exists only in memory."""
    message = f"Optuna would keep its study of `{storage}` in memory, where it ends with the sweep"
    repair = "give a file, `--optuna runs/study.db`, or a database, `--optuna postgresql://…`"
    return error("E0859", None, message, help=repair)


def lost_study(storage: str, why: str) -> Diagnostic:
    """E0858: an Optuna storage failed during a sweep."""
    message = f"Optuna's study in `{storage}` cannot be used any more: {why}"
    repair = (
        "see to the file or the database, and run the same command again: it trains nothing again "
        "that the log has"
    )
    return error("E0858", None, message, help=repair)


def unusable_study(storage: str, why: str) -> Diagnostic:
    """E0856: Optuna cannot use a storage."""
    message = f"Optuna cannot keep its study in `{storage}`: {why}"
    repair = "give a file, `--optuna runs/study.db`, or a database, `--optuna postgresql://…`"
    return error("E0856", None, message, help=repair)
