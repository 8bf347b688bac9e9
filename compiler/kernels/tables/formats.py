"""The two IEEE 754 formats of the math kernels, float32 and float64."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

RealName = Literal["float", "double"]


@dataclass(frozen=True, slots=True)
class Format:
    """A binary floating-point format: `digits` bits of significand, values below
    2^`overflow_exponent`, and the smallest positive (subnormal) value 2^`smallest_exponent`.
    """

    c_type: RealName
    dtype: np.dtype[Any]
    digits: int
    overflow_exponent: int
    smallest_exponent: int

    @property
    def largest(self) -> float:
        """The largest finite value of the format."""
        return (2.0 - 2.0 ** (1 - self.digits)) * 2.0 ** (self.overflow_exponent - 1)


# the smallest positive numbers are subnormal: 2^−126 · 2^−23 and 2^−1022 · 2^−52
FLOAT = Format(
    c_type="float",
    dtype=np.dtype(np.float32),
    digits=24,
    overflow_exponent=128,
    smallest_exponent=-149,
)
DOUBLE = Format(
    c_type="double",
    dtype=np.dtype(np.float64),
    digits=53,
    overflow_exponent=1024,
    smallest_exponent=-1074,
)

FORMATS: dict[RealName, Format] = {"float": FLOAT, "double": DOUBLE}
