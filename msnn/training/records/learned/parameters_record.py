"""Describes learned parameters with their standard errors, and warns of undetermined ones."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from compiler.differentiation.sums_of_squares import is_sum_of_squares
from compiler.ir.program import Parameter, Program
from msnn.data.dataset import BoolArray, FloatArray
from msnn.errors.learning.stages import not_identifiable
from msnn.errors.learning.training import at_bound, stuck_at_bound
from msnn.training.records.curves import finite
from msnn.training.records.learned.beside_bounds import is_near_bound
from msnn.training.records.learned.standard_errors import StandardErrors
from spec_schema.diagnostics.diagnostic import Diagnostic


def parameters_record(
    program: Program, weights: Mapping[str, FloatArray], found: StandardErrors | None
) -> dict[str, Any]:
    """The content of `parameters.json`: every parameter with unit, values and standard errors.

    The standard error of an element is null if it was not trained in the last stage or is at a
    bound. It is also null for zeros set by a penalty and for unidentifiable elements.
    """
    errors: Mapping[str, FloatArray] = {} if found is None else found.errors
    record: dict[str, Any] = {
        "parameters": [
            {
                "name": parameter.name,
                "unit": parameter.unit and parameter.unit.text,
                "shape": [axis.size for axis in parameter.axes],
                "initial": finite(list(parameter.initial)),
                "values": finite(weights[parameter.name].ravel().tolist()),
                "learn": parameter.learn,
                "at_bound": parameter.learn and bool(is_at_bound(parameter, weights, found).any()),
                "standard_errors": finite(errors[parameter.name].ravel().tolist())
                if parameter.name in errors
                else None,
            }
            for parameter in program.parameters
        ]
    }
    zero = zero_slices(program, weights)
    if zero:
        record["zero_slices"] = zero
    if found is not None:
        record["standard_errors"] = {
            "residuals": found.residuals,
            "noise": dict(found.noise),
            "unidentified": [dict(change) for change in found.unidentified],
            "reason": found.reason,
        }
    return record


def is_at_bound(
    parameter: Parameter, weights: Mapping[str, FloatArray], found: StandardErrors | None
) -> BoolArray:
    """The elements at a bound, by the derivative if known, else by the distance."""
    known = None if found is None or found.beside is None else found.beside.held
    if known is not None and parameter.name in known:
        return known[parameter.name]
    return is_near_bound(parameter, weights[parameter.name])


def has_unidentified(record: Mapping[str, Any], found: Mapping[str, Any]) -> bool:
    """True if an element of a learned parameter has no standard error, apart from penalised zeros.

    `found` is the entry of the parameter in the record.
    """
    penalised = {each["array"] for each in record.get("zero_slices", ())}
    by_penalty = found["name"] in penalised
    errors = found["standard_errors"] or ()
    return any(
        error is None and not (by_penalty and value == 0.0)
        for value, error in zip(found["values"], errors, strict=False)
    )


def zero_slices(program: Program, weights: Mapping[str, FloatArray]) -> list[dict[str, Any]]:
    """The parts of arrays that a penalty has set to 0: slices for `group`, a number of elements for
    `l1`.

    Slices are named by the labels of their dimension, else by their index from 0.
    """
    labels = {dimension.name: dimension.labels for dimension in program.dimensions}
    found: list[dict[str, Any]] = []
    for loss in program.losses:
        penalty = loss.penalty
        if penalty is None:
            continue
        value = weights[penalty.parameter]
        record: dict[str, Any] = {"array": penalty.parameter, "over": penalty.over}
        if penalty.over is None:
            zeros, size = int(np.count_nonzero(value == 0.0)), value.size
            record |= {"of": size, "zero": zeros}
        else:
            names = [axis.name for axis in program.parameter(penalty.parameter).axes]
            slices = np.moveaxis(value, names.index(penalty.over), 0)
            zero = [i for i, one in enumerate(slices) if not one.any()]
            known = labels.get(penalty.over, ())
            zeros = len(zero)
            record |= {"of": len(slices), "zero": [known[i] if known else i for i in zero]}
        if zeros:
            found.append(record)
    return found


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
