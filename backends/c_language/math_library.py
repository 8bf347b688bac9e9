"""Defines the option for math functions in generated code: own kernels or the target's C
library.
"""

from __future__ import annotations

from typing import Literal

MathLibrary = Literal["own", "libm"]
"""The msnn kernels, or the target's C library where it has the function."""
