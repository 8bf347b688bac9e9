"""Warns of learned parameters at a bound, or not determined by the data."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np

from compiler.differentiation.sums_of_squares import is_sum_of_squares
from compiler.ir.program import Program
from msnn.data.dataset import FloatArray
from msnn.errors.learning.second_order import not_identifiable
from msnn.errors.learning.training import at_bound, stuck_at_bound
from msnn.training.records.learned.parameters_record import at_bound as is_at_bound
from msnn.training.records.learned.standard_errors import StandardErrors
from spec_schema.diagnostics.diagnostic import Diagnostic

_SHARE = 1e-3
"""Minimum relative component of an element in a direction, as in the standard errors."""


def parameter_warnings(
    program: Program,
    weights: Mapping[str, FloatArray],
    found: StandardErrors | None,
    black_boxes: frozenset[str] = frozenset(),
) -> list[Diagnostic]:
    """Warnings for learned parameters at a bound and for those that the data do not determine.

    Notes of the standard errors come first. Unidentifiable weights within `black_boxes` are not
    reported, because they have no physical meaning.
    """
    warnings = [] if found is None else list(found.notes)
    beside = None if found is None else found.beside
    are_squares = all(
        one.penalty is not None or is_sum_of_squares(program.step, one) for one in program.losses
    )
    for parameter in (each for each in program.parameters if each.learn):
        is_known = beside is not None and parameter.name in beside.held
        if is_at_bound(parameter, weights, found).any():
            warnings.append(at_bound(parameter.name, parameter.span, is_pushed=is_known))
        if beside is not None and is_known and beside.stuck[parameter.name].any():
            warnings.append(stuck_at_bound(parameter.name, parameter.span, are_squares=are_squares))
    for group in [] if found is None else _together(found.unidentified):
        changes, beside = _of_readable(group, black_boxes)
        if not changes:
            continue
        numbers = Counter(_owner(name) for name in {name for change in changes for name in change})
        concerned = {
            p.name: (numbers[p.name], weights[p.name].size)
            for p in program.parameters
            if numbers[p.name]
        }
        first = program.parameter(next(iter(concerned)))
        warnings.append(not_identifiable(changes, concerned, beside, first.span))
    return warnings


def _of_readable(
    changes: Sequence[Mapping[str, float]], black_boxes: frozenset[str]
) -> tuple[Sequence[Mapping[str, float]], list[str]]:
    """A minimal set of changes without weights of black boxes, and these black boxes.

    Sums of changes are changes too, so every basis is equivalent. The SVD separates the changes
    that only affect black boxes, and these are removed from the others.
    """
    names = list(dict.fromkeys(name for change in changes for name in change))
    layers = [_owner(name).rpartition(".")[0] for name in names]
    is_read = np.array([layer not in black_boxes for layer in layers])
    if is_read.all():
        return changes, []
    moves = np.array([[change.get(name, 0.0) for name in names] for change in changes])
    # columns of `turned` combine changes, in order of how far they move what is read
    turned, sizes, _ = np.linalg.svd(moves[:, is_read])
    shows = np.zeros(len(moves), dtype=np.bool_)
    # more changes than readable numbers: the combinations beyond move none of these
    shows[: len(sizes)] = sizes > _SHARE
    shown, alone = turned[:, shows].T @ moves, turned[:, ~shows].T @ moves
    found: list[Mapping[str, float]] = []
    beside: dict[str, None] = {}
    # less their projection on changes of black boxes alone, of which any amount may be added
    for move in shown - shown @ np.linalg.pinv(alone) @ alone:
        move = move / move[np.argmax(np.abs(move * is_read))]
        kept = np.abs(move) > _SHARE
        found.append({names[i]: float(move[i]) for i in np.flatnonzero(kept & is_read)})
        beside |= dict.fromkeys(layers[i] for i in np.flatnonzero(kept & ~is_read))
    return found, list(beside)


def _owner(number: str) -> str:
    """The parameter that an element belongs to."""
    return number.partition("[")[0]


def _together(changes: Sequence[Mapping[str, float]]) -> list[list[Mapping[str, float]]]:
    """Groups of changes that have no parameter in common."""
    groups: list[tuple[set[str], list[Mapping[str, float]]]] = []
    for change in changes:
        owners, members = {_owner(name) for name in change}, [change]
        apart: list[tuple[set[str], list[Mapping[str, float]]]] = []
        for group in groups:
            # a change can join groups that had nothing in common before it
            if group[0] & owners:
                owners, members = owners | group[0], group[1] + members
            else:
                apart.append(group)
        groups = [*apart, (owners, members)]
    return [members for _, members in groups]
