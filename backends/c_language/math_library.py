"""Names whose scalar functions generated code calls."""

from __future__ import annotations

from typing import Literal

MathLibrary = Literal["own", "libm"]
"""The project's kernels, or those of the target's C library where it has them."""
