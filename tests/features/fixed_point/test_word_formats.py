"""The number format of a word holds its whole range, after rounding too."""

import pytest

from msnn.features.fixed_point.compile.word_formats import word_format


@pytest.mark.parametrize("bits", [16, 32])
@pytest.mark.parametrize(
    ("low", "high"), [(-1.0, 1.0), (0.0, 2 - 2.0**-40), (-0.3, 0.7), (0.0, 0.0), (-1e6, 3.0)]
)
def test_limits_fit_into_the_word_and_no_larger_fraction_would(low: float, high: float, bits: int):
    fraction, least, greatest = word_format(low, high, bits)
    largest = 2 ** (bits - 1) - 1
    assert -largest <= least <= greatest <= largest
    assert (least, greatest) == (round(low * 2.0**fraction), round(high * 2.0**fraction))
    if low or high:
        assert max(-low, high) * 2.0 ** (fraction + 1) > largest
