"""Refuses functions that mix rows, or depend on the number of rows."""

from __future__ import annotations

import ast
from collections.abc import Sequence

import numpy as np

from msnn.features.nnodely.followed_python.python_function import follow
from msnn.features.nnodely.followed_python.python_source import FunctionError
from msnn.features.nnodely.terms.arrays import ROWS, Elements
from msnn.features.nnodely.terms.terms import Named, Term, text_of_whole


def refuse_mixed_rows(
    function: ast.FunctionDef, shapes: Sequence[tuple[int, int]], own: Sequence[Elements]
) -> None:
    """Ends the import for a function that mixes rows of its arguments."""
    alone, among = (_followed(function, rows, shapes, own) for rows in (1, ROWS))
    # no batch at all: what follows the function refuses it with its shape
    if alone.ndim != 3 or alone.shape[0] != 1:
        return
    # compared as texts: terms are equal by identity alone
    is_separate = among.shape == (ROWS, *alone.shape[1:]) and _texts(alone) == _texts(among)
    if not is_separate:
        reason = "its value depends on the other samples that are evaluated with one"
        raise FunctionError(function.lineno, reason)


def _followed(
    function: ast.FunctionDef,
    rows: int,
    shapes: Sequence[tuple[int, int]],
    own: Sequence[Elements],
) -> Elements:
    streams = [_symbols(rows, i, shape) for i, shape in enumerate(shapes)]
    found = follow(function, [*streams, *own], rows)
    assert isinstance(found, np.ndarray)
    return found


def _symbols(rows: int, argument: int, shape: tuple[int, int]) -> Elements:
    """An argument, each of its elements by a name of its own; the row in the middle is row 0."""
    out = np.empty((rows, *shape), dtype=object)
    for row, sample, i in np.ndindex(*out.shape):
        out[row, sample, i] = Term(Named(f"x{argument} {row - rows // 2} {sample} {i}"))
    return out


def _texts(found: Elements) -> list[str]:
    middle = found[len(found) // 2]
    return [text_of_whole(one) if isinstance(one, Term) else str(one) for one in middle.ravel()]
