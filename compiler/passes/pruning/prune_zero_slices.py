"""Removes slices of learned arrays that are exactly 0, and all nodes that only they use."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from compiler.ir.graph_copy import with_start, with_step
from compiler.ir.program import NodeId, Parameter, Program
from compiler.ir.types import Axis
from compiler.passes.analyses.kept_slices import Cut, Kept
from compiler.passes.analyses.selected_elements import Asked, SelectedElements
from compiler.passes.pruning.drop_zero_numbers import drop_zero_numbers
from compiler.passes.simplify.drop_unused import drop_unused
from compiler.passes.simplify.fold_constants import fold_constants
from compiler.passes.simplify.share_common import share_common

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Pruned:
    """A smaller program, and the parts of the arrays that it needs."""

    program: Program
    cuts: tuple[Cut, ...]


def prune_zero_slices(
    program: Program, weights: Mapping[str, FloatArray], arrays: Collection[str]
) -> Pruned:
    """Removes zero terms from sums, and elements of values that are no longer needed.

    A slice of one of the `arrays` counts if all its elements are exactly 0, as does an array that
    is entirely 0 (`drop_zero_numbers`). The new program has the same outputs if all values that are
    multiplied by 0 are finite: 0 · ∞ is also removed.

    Before: window form, no losses. After: the same form.

        %2: [hid=4] = contract(%1, %0) over t
        %4: scalar = contract(%w, %3) over hid      # hid 1 and 3 of w are 0

        %2: [hid=2] = contract(%1, %0) over t
        %4: scalar = contract(%w, %3) over hid
    """
    values = {name: np.asarray(weights[name], float) for name in arrays if name in weights}
    program = drop_zero_numbers(program, {n for n, value in values.items() if not value.any()})
    values = {name: value for name, value in values.items() if _has_zero_slice(value)}
    if not values.keys() & {parameter.name for parameter in program.parameters}:
        return Pruned(program, ())
    asked: Asked = {}
    step = SelectedElements(program.step, values, _roots(program), asked)
    start = SelectedElements(program.start, values, [s.start for s in program.states], asked)
    # an array is cut only if all its readers agree: a file of weights has one shape
    cuts = {
        place: next(iter(kept))
        for place, kept in asked.items()
        if len(kept) == 1 and None not in kept
    }
    chosen = {place: kept for place, kept in cuts.items() if kept is not None}
    small = replace(program, expected=())
    small = with_step(small, *step.rebuilt(chosen))
    small = with_start(small, *start.rebuilt(chosen))
    parameters = tuple(_cut(parameter, chosen) for parameter in program.parameters)
    # only values that are still whole keep their expected ranges
    small = replace(small, parameters=parameters, expected=step.expected(program.expected))
    # inserted zeros may now be folded
    small = drop_unused(share_common(fold_constants(small)))
    left = {parameter.name for parameter in small.parameters}
    found = [
        Cut(name, at, program.parameter(name).axes[at].size, kept)
        for (name, at), kept in chosen.items()
        if name in left
    ]
    return Pruned(small, tuple(found))


def _has_zero_slice(value: FloatArray) -> bool:
    return any(
        not np.moveaxis(value != 0.0, at, 0).reshape(size, -1).any(axis=1).all()
        for at, size in enumerate(value.shape)
    )


def _roots(program: Program) -> list[NodeId]:
    states = [state.next for state in program.states]
    return [*states, *(output.node for output in program.outputs)]


def _cut(parameter: Parameter, cuts: Mapping[tuple[str, int], Kept]) -> Parameter:
    values = np.reshape(parameter.initial, [axis.size for axis in parameter.axes])
    axes = list(parameter.axes)
    for at, axis in enumerate(parameter.axes):
        kept = cuts.get((parameter.name, at))
        if kept is not None:
            values = np.take(values, kept, axis=at)
            axes[at] = Axis(axis.name, len(kept))
    return replace(parameter, axes=tuple(axes), initial=tuple(values.ravel().tolist()))
