"""Describes parameters from which slices along an axis were removed (pruning)."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np
from numpy.typing import NDArray

from spec_schema.late_dataclass import dataclass

FloatArray = NDArray[np.float64]
Kept = tuple[int, ...]
"""Indices along an axis that are kept, in ascending order."""


@dataclass(frozen=True, slots=True)
class Cut:
    """One axis of a parameter from which slices were removed, and the indices of those
    that remain.
    """

    parameter: str
    position: int
    """Index of the axis."""
    size: int
    """Length of the axis before the cut."""
    kept: Kept


def cut_weights(cuts: Collection[Cut], weights: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """A copy of the weights in which each array keeps only the slices that its cuts list."""
    found = dict(weights)
    for cut in cuts:
        if cut.parameter in found:
            found[cut.parameter] = np.take(found[cut.parameter], cut.kept, axis=cut.position)
    return found
