"""What the sentences of `benchmarks/mutation/digit_equivalents.py` say of numbers, where it can be
tried at all of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_SINGLE = np.float32


def test_factors_beside_the_right_one_split_every_number_into_halves_of_twelve_digits() -> None:
    """So the rest of a product is exact with them, too; halves of 13 digits would round it."""
    numbers = np.arange(0x3F800000, 0x40000000, dtype=np.uint32).view(_SINGLE)
    right = _SINGLE(2.0**12 + 1.0)
    for factor in (np.nextafter(right, _SINGLE(0.0)), np.nextafter(right, _SINGLE(np.inf))):
        scaled = numbers * factor
        high = scaled - (scaled - numbers)
        low = numbers - high
        assert (high.astype(np.float64) + low == numbers).all()
        assert max(_digits(high), _digits(low)) == 12
    coarse = numbers * _SINGLE(2.0**10 + 1.0)
    assert (
        _digits(numbers - (coarse - (coarse - numbers))) < 12 < _digits(coarse - (coarse - numbers))
    )


def test_below_the_limit_of_powers_even_the_second_word_leaves_no_result() -> None:
    """Half the float nearest to 0 is e^(-150 ln 2); the word behind is half a unit at most."""
    beyond = _SINGLE(-float.fromhex("0x1.9fe36ap+6"))
    rest = float(np.spacing(-beyond)) / 2.0
    assert float(beyond) + rest < -150.0 * np.log(2.0) - 3e-6


def _digits(numbers: NDArray[np.floating]) -> int:
    """The most binary digits of a significand."""
    significands = (np.frexp(numbers)[0] * 2.0**24).astype(np.int64)
    lowest = significands & -significands
    return 24 - int(np.log2(lowest[lowest > 0].min()))
