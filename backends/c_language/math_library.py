"""Names the source of scalar functions in generated code."""

from __future__ import annotations

from typing import Literal

MathLibrary = Literal["own", "libm"]
"""The msnn kernels, or the target's C library where it has the function."""
