"""E0827 to E0829 and E1130: files of data that `msnn init --data` cannot make a spec of."""

from __future__ import annotations

from spec_schema.diagnostics.diagnostic import Diagnostic, error


def no_table(file: str, format: str | None = None) -> Diagnostic:
    """E0827: a file in which `msnn init --data` finds no columns of numbers."""
    if format is not None:
        message = f"`init --data` reads tables of text and workbooks, and {file} is {format}"
        repair = f"begin with `msnn init NAME`, and write `data: {{source: {{train: {file}}}}}`"
        return error("E0827", None, message, help=repair)
    message = f"{file} has no lines of numbers with cells between `,`, `;`, `|` or tabs"
    return error("E0827", None, message, help="other formats are read by a spec: `data:`")


def no_target(file: str) -> Diagnostic:
    """E0828: a file in which no column but the time moves."""
    message = f"no column of {file} but the time changes: there is nothing to predict"
    return error("E0828", None, message, help="record the signals while the system moves")


def few_rows(file: str, rows: int, needed: int) -> Diagnostic:
    """E0829: a file with too few rows to train and to validate."""
    message = f"{file} has {rows} rows, too few to train on some and to validate on others"
    return error("E0829", None, message, help=f"at least {needed} are needed")


def falling_time(file: str, column: str) -> Diagnostic:
    """E1130: a file whose last row is the first in time."""
    message = f"`{column}` of {file} falls from row to row: a record goes forward in time"
    repair = f"sort its rows by `{column}`; if that is no time, give the column another name"
    return error("E1130", None, message, help=repair)
