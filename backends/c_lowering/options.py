"""Defines the choices a user has about generated C: the `export: c:` entry of a spec."""

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
    """The choices that `write_c` leaves; the defaults suit a core with a single-precision FPU."""

    dtype: Dtype = "float32"
    params: ParameterAccess = "const"
    """`const` and `tunable` give the step a pointer to its parameters, to the defaults in flash or
    to a copy in RAM that may change between steps (passes may fold across the first, never across
    the second). `calibration` is `tunable` with such a copy in a section of its own, beside its
    checksum. `inline` writes the numbers into the code and has no such pointer."""
    prefix: str | None = None
    """Begins every public name; None takes the program's name."""
    math: MathLibrary = "own"
    """`own` gives the same bits on every target; `libm` calls the target's library where it can."""
    ring: Ring = "auto"
    """How buffers move: `shift` copies by one sample a step, `double` keeps each sample twice and
    never moves any, `auto` shifts short windows and doubles long ones."""
    unroll: int = 4
    """Elements up to which a loop is written out."""
    constant_time: bool = False
    """Whether every step takes the same instructions, whatever its numbers are."""

    extras: tuple[Extra, ...] = ()
    """Functions beside the step: `jacobian` linearises it in all that it remembers and its inputs,
    `state_jacobian` in its declared states alone instead, `parameter_jacobian` in its parameters
    too, `feedthrough` in its inputs alone."""

    ros2: bool = False
    """Whether a node of ROS 2 is written around the code."""

    @property
    def moves_parameters(self) -> bool:
        """Whether parameters may change between steps."""
        return self.params in ("tunable", "calibration")

    @property
    def is_exact(self) -> bool:
        """Whether every build gives the bits of the float32 interpreter.

        In float64 the interpreter calls numpy's functions, and a C library is a third one.
        """
        return self.dtype == "float32" and self.math == "own"
