"""Options of generated C: the `export: c:` entry of a spec."""

from __future__ import annotations

from typing import Literal

from backends.c_language.literals import Dtype
from backends.c_language.math_library import MathLibrary
from spec_schema.late_dataclass import dataclass

Ring = Literal["auto", "shift", "double"]
ParameterAccess = Literal["const", "tunable", "calibration", "inline"]
Extra = Literal["jacobian", "state_jacobian", "parameter_jacobian", "feedthrough"]


@dataclass(frozen=True, slots=True, kw_only=True)
class COptions:
    """Options of `write_c`; the defaults suit a core with a single-precision FPU."""

    dtype: Dtype = "float32"
    params: ParameterAccess = "const"
    """`const` and `tunable` pass a pointer to parameters to the step: constants in flash, or a
    copy in RAM that may change between steps. `calibration` is `tunable` with the copy in a
    separate section, next to its checksum. `inline` writes values into the code, without a
    pointer. Passes may fold `const` parameters, but not tunable ones."""
    prefix: str | None = None
    """Prefix of every public name; None uses the program's name."""
    math: MathLibrary = "own"
    """`own` gives the same bits on every target; `libm` calls the target's library where
    possible."""
    ring: Ring = "auto"
    """`shift` copies a buffer by one sample per step. `double` stores each sample twice and
    moves none. `auto` shifts short windows and doubles long ones."""
    unroll: int = 4
    """Maximum number of elements for which a loop is unrolled."""
    constant_time: bool = False
    """True if every step executes the same instructions for all values."""

    extras: tuple[Extra, ...] = ()
    """Additional functions: `jacobian` linearises the step in its whole memory and inputs,
    `state_jacobian` in its declared states only, `parameter_jacobian` also in parameters,
    `feedthrough` in inputs only."""

    ros2: bool = False
    """True to write a ROS 2 node around the code."""

    @property
    def moves_parameters(self) -> bool:
        """True if parameters may change between steps."""
        return self.params in ("tunable", "calibration")

    @property
    def is_exact(self) -> bool:
        """True if every build gives the bits of the float32 interpreter.

        In float64 the interpreter calls numpy's functions, which differ from a C library's.
        """
        return self.dtype == "float32" and self.math == "own"
