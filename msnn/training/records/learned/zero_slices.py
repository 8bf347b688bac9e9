"""Names the slices of learned arrays that penalties set to exactly 0."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from compiler.ir.program import Program
from msnn.data.dataset import FloatArray


def zero_slices(program: Program, weights: Mapping[str, FloatArray]) -> list[dict[str, Any]]:
    """The zero slices of every array with `group`, and the number of zeros of arrays with `l1`.

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
