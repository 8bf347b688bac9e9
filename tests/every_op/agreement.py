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


def assert_same_bits(
    actual: NDArray[np.floating], expected: NDArray[np.floating], what: str
) -> None:
    """Both are float32 and have the same bits; a NaN may have any sign and payload."""
    assert actual.dtype == expected.dtype == np.float32, what
    missing = np.isnan(expected)
    np.testing.assert_array_equal(np.isnan(actual), missing, what)
    found = np.where(missing, np.float32(0), actual).view(np.uint32)
    wanted = np.where(missing, np.float32(0), expected).view(np.uint32)
    differing = np.nonzero(found != wanted)
    if differing[0].size:
        place = tuple(int(i[0]) for i in differing)
        message = f"{what} at {place}: {actual[place]!r}, not {expected[place]!r}"
        raise AssertionError(message)
