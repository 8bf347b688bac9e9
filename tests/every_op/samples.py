"""Samples and axes that the records of `test_every_op` share."""

from __future__ import annotations

import numpy as np

from compiler.ir.types import Axis
from tests.every_op.record import SMOOTH_ROWS, Array

JOINT, BASIS, WHEEL = Axis("joint", 3), Axis("basis", 2), Axis("wheel", 4)

PAIRS = np.array(
    [
        (np.nan, 1.0),
        (1.0, np.nan),
        (np.nan, np.nan),
        (np.inf, 1.0),
        (-1.0, np.inf),
        (np.inf, np.inf),
        (np.inf, -np.inf),
        (0.0, 0.0),
        (-0.0, 0.0),
        (2.0, 2.0),
        (2.0, 0.0),
        (-2.0, 0.0),
        (0.0, 3.0),
        (1.0, 1.0),  # the last row is read by previews only
    ]
)
"""Operands of which one is NaN, infinite or zero, and ties."""

SPECIAL = np.array([np.nan, np.inf, 1.0, 2.0, -1.0, 1.0])
"""Single samples that structure must carry along; the last row is read by previews only."""

ROWS = SMOOTH_ROWS + len(PAIRS)


def smooth(seed: int, *shape: int, shift: float = 0.0) -> Array:
    """Samples of 0.3 … 2 with either sign. Series of different `shift` in [0, 1) have no sample in
    common, at least the difference of their shifts of one step apart."""
    random = np.random.default_rng(seed)
    size = SMOOTH_ROWS * int(np.prod(shape, dtype=int))
    step = 1.7 / size
    magnitudes = 0.3 + step * (random.permutation(size) + shift)
    signs = random.integers(0, 2, size) * 2.0 - 1.0
    return (magnitudes * signs).reshape(SMOOTH_ROWS, *shape)


def with_special(samples: Array, special: Array) -> Array:
    """The samples followed by the special ones, each in all elements of its row."""
    rows = special.reshape(len(special), *(1 for _ in samples.shape[1:]))
    return np.concatenate([samples, np.broadcast_to(rows, (len(special), *samples.shape[1:]))])


def operand(place: int, *shape: int) -> Array:
    """ROWS samples for the first or second operand: smooth ones, then one side of PAIRS."""
    return with_special(smooth(place, *shape, shift=0.5 * place), PAIRS[:, place])
