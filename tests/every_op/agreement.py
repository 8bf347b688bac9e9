"""What it means that two backends agree: |a − b| ≤ tol · max(|b|, s), NaN and ∞ at equal places."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def assert_agrees(
    actual: NDArray[np.floating], expected: NDArray[np.floating], tolerance: float, what: str
) -> None:
    """s is the largest finite magnitude of the expectation."""
    assert actual.shape == expected.shape, f"{what}: shape {actual.shape}, not {expected.shape}"
    found, wanted = actual.astype(np.float64), expected.astype(np.float64)
    plain = np.isfinite(wanted)
    # NaN equals NaN here, and an infinity only itself
    np.testing.assert_array_equal(found[~plain], wanted[~plain], what)
    scale = np.abs(wanted[plain]).max(initial=0.0)
    allowed = tolerance * np.maximum(np.abs(wanted), scale)
    with np.errstate(invalid="ignore"):
        wrong = plain & ~(np.abs(found - wanted) <= allowed)
    if wrong.any():
        place = tuple(int(i[0]) for i in np.nonzero(wrong))
        message = f"{what} at {place}: {found[place]!r}, not {wanted[place]!r}"
        raise AssertionError(message)
