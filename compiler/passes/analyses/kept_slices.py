"""Says what is kept of learned arrays of which slices are left out."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np
from numpy.typing import NDArray

from spec_schema.late_dataclass import dataclass

FloatArray = NDArray[np.float64]
Kept = tuple[int, ...]
"""Indices along an axis, in order."""


@dataclass(frozen=True, slots=True)
class Cut:
    """The slice that is kept of an array along one of its axes."""

    parameter: str
    position: int
    """Of the axis."""
    size: int
    """How many elements there are."""
    kept: Kept


def cut_weights(cuts: Collection[Cut], weights: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """The weights with what the cuts keep of them."""
    found = dict(weights)
    for cut in cuts:
        if cut.parameter in found:
            found[cut.parameter] = np.take(found[cut.parameter], cut.kept, axis=cut.position)
    return found
