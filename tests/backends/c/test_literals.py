"""Literals of C read back as the bits of their numbers."""

from __future__ import annotations

import numpy as np
import pytest

from backends.c_language.literals import Dtype, exact_literal, hex_literal, real_literal


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_every_literal_has_all_digits(dtype: Dtype) -> None:
    bits = np.uint32 if dtype == "float32" else np.uint64
    random = np.random.default_rng(3)
    drawn = random.integers(0, np.iinfo(bits).max, 4000, dtype=bits, endpoint=True).view(dtype)
    number = np.dtype(dtype).type
    limits = np.finfo(dtype)
    # numbers that take nine digits, or seventeen
    near = [number(1) + limits.eps, number(0.1), number(1) / number(3), limits.max, limits.tiny]
    for value in [*drawn[np.isfinite(drawn)], *near, limits.smallest_subnormal, number(-0.0)]:
        given = float(value)
        for text in (real_literal(given, dtype), exact_literal(given, dtype)):
            plain = text.removesuffix("f") if dtype == "float32" else text
            read = float.fromhex(plain) if "0x" in plain else number(plain)
            assert number(read).tobytes() == value.tobytes(), text
        plain = hex_literal(given, dtype)
        plain = plain.removesuffix("f") if dtype == "float32" else plain
        assert number(float.fromhex(plain)).tobytes() == value.tobytes(), plain
