"""Lists the numerical constants of generated solvers (decision 0236), and formats numbers as C."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from backends.c_language.literals import Dtype, real_literal
from backends.c_language.rendering import comment
from compiler.kernels.tables.formats import RealName
from msnn.features.control.problem.optimal_control import Mode
from msnn.features.control.problem.structure import Chosen

_FAR = 1e3
"""Limit of simulated states, as a multiple of their scales or of their measured start."""


def reachable(tolerance: float, dtype: Dtype) -> float:
    """Returns the tolerance for a solver that computes in `dtype`: in float32 at least 1e-3, as
    rounding limits the residuals.
    """
    # float32 has a relative precision of 1.2e-7, and residuals are differences of long sums of
    # products
    return tolerance if dtype == "float64" else max(tolerance, 1e-3)


def floor_of_curvature(dtype: Dtype) -> float:
    """Returns the floor of Hessian eigenvalues, in variables divided by their scales."""
    return 1e-8 if dtype == "float64" else 1e-5


def most_factors(largest_scale: float, dtype: Dtype) -> float:
    """Returns how many values of a plan have a product that is finite in this type.

    The largest value is FAR² · `largest_scale`: simulations stop at FAR times the measured start,
    which itself may be FAR times its scale. `largest_scale` is the maximum of all scales.
    """
    return float(np.log(np.finfo(dtype).max) / np.log(_FAR**2 * largest_scale))


def solver_constants(
    tolerance: float,
    dtype: Dtype,
    structure: Chosen,
    mode: Mode,
    *,
    can_be_infinite: bool,
    has_hard: bool,
    projects: bool,
) -> list[dict[str, str]]:
    """Returns name, C literal and meaning (a comment in the generated C) of each solver constant.

    `projects` is True for a solver that can project onto limits of controls.
    """
    # machine epsilon, the distance of 1 from the next number: rounding errs by at most half of it
    precision = float(np.finfo(dtype).eps)
    exact = dtype == "float64"
    is_staged = structure == "staged"
    table: list[tuple[str, float, str]] = [
        ("TOLERANCE", tolerance, "Largest error of the optimality conditions of what is solved."),
        ("LEAST_MU", tolerance / 10, "Barrier at the end."),
        ("LOWEST_MU", 10 * tolerance, "Lowest barrier at the beginning of a solve."),
        ("HIGHEST_MU", 0.3, "Highest one."),
        ("FIRST_MU", 0.1, "Barrier while nothing is known."),
        ("WIDE_MU", 1.0, "Barrier after a plan was simulated anew."),
        ("WIDE_SHARE", 0.1, "The same without a plan, by the largest error of slopes and gaps."),
        (
            "BARRIER_SHARE",
            (0.1 if mode == "fixed" else 0.03) if is_staged else 0.003,
            "First barrier by the largest error of slopes and gaps.",
        ),
        (
            "KEEP",
            0.99 if is_staged else 0.999,
            "Part of a slack or multiplier that one step may use up.",
        ),
        (
            "NEARLY",
            30.0 if is_staged else 100.0,
            "Error by the barrier below which the barrier is lowered.",
        ),
        ("SHRINK", 0.1, "Largest factor by which it is lowered."),
        ("FASTER", 10.0, "The same by the barrier, where that is less."),
        (
            "FEWEST",
            0.1 if is_staged else 0.3,
            "Least product of slack and multiplier at the beginning, by the barrier.",
        ),
        ("MOST", 1e3, "Largest one."),
        ("EDGE", 1e-2, "Least slack of a soft side at the beginning, by its scale."),
        ("PULL", 1e-2, "Least distance of a control from its limits in a plan that is simulated."),
        (
            "NEAR_PULL",
            1e-2 if is_staged else 1e-5,
            "The same in the plan of the sample before.",
        ),
        ("ROUNDING", precision / 2, "Largest error of a rounded number, by its size."),
        ("LEAST_SLACK", 4 * precision, "Least slack of a control, by its scale: rounding."),
        ("LEAST_CURVATURE", floor_of_curvature(dtype), "Floor of curvatures, by scales."),
        ("LEAST_SHARE", 1e-4, "Floor of the curvature of a control by its own stage's."),
        ("ROTATED", 1e-24 if exact else 1e-12, "Part off the diagonal that counts as none."),
        ("STEEP", 1e7 if exact else 1e3, "Ratio whose hypotenuse is itself."),
        ("FAINT", 1e3 * precision, "Excess, by the distance of its limit, that rounding hides."),
        ("ENOUGH", 1e-4, "Part of the promised decrease that a step must give."),
        ("LEAST_GAIN", 1e-5, "Part by which gaps must shrink."),
        ("NOISE", 1e-3 * tolerance if exact else 0.1 * tolerance, "Increase that is rounding."),
        ("NO_GAP", 1e-3 * tolerance, "Sum of gaps that counts as none."),
        ("SHORT", 0.15, "Step that is short."),
        ("HUGEST", float(np.finfo(dtype).max), "Where the least of products begins."),
        ("SMALL_RATIO", 1e-8, "Products of ratios beyond this are taken apart."),
        ("LARGE_RATIO", 1e8, "The same for large ones."),
        ("FAR", _FAR, "How far a plant is followed, by the scales of its states or its start."),
        ("LEAST_ROOM", 1e-9 if exact else 1e-5, "Distance of limits that leaves a control room."),
    ]
    if not is_staged:
        table += [
            ("ANEW_SHARE", 0.3, "Barrier of a plan that is not near, by the largest slope."),
            ("ROUNDED", 16 * precision, "Floor of a pivot by its diagonal: rounding."),
        ]
    if projects:
        table += [
            ("NEARER", 0.1, "Part of the residual that a projection leaves at most."),
            ("WIDER", 10.0, "Factor by which the distance grows that counts as at a limit."),
            ("WIDEST_EDGE", 0.1, "Where that ends, by the scale of a control."),
        ]
    if can_be_infinite:
        steepest = 1e8 if exact else 1e4
        table.append(("STEEPEST", steepest, "Slope that stands for an infinite one."))
    of_hard = [
        ("HARD_TOLERANCE", tolerance, "Violation, by its scale, of what holds."),
        ("HARDER", 10.0, "Factor by which the cost of violating what must hold grows."),
        ("HARDEST", 1e6 if exact else 1e3, "Where it ends: then nothing can hold it."),
    ]
    table += of_hard if has_hard else []
    return [
        {"name": name, "value": real_literal(value, dtype), "text": text}
        for name, value, text in table
    ]


@dataclass(frozen=True, slots=True)
class TypedLiterals:
    """Formatter of C literals of one floating-point type."""

    dtype: Dtype

    @property
    def real(self) -> RealName:
        """The name of the type in C."""
        return "float" if self.dtype == "float32" else "double"

    def literal(self, value: float) -> str:
        """Returns a C literal that reads back as the value rounded to the type."""
        return real_literal(float(value), self.dtype)

    def braced(self, values: Iterable[float]) -> str:
        """Returns the initialiser of a C array; ints become integer literals."""
        texts = (str(x) if isinstance(x, int) else self.literal(x) for x in values)
        return "{" + ", ".join(texts) + "}"

    def comment(self, text: str) -> str:
        """Returns a C comment, wrapped to lines."""
        return comment(text)
