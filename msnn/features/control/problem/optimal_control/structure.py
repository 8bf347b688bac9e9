"""Estimates the work of a solver step for each structure of its equations, and chooses one.

Staged: a Riccati recursion over N stages, whose products are of matrices as wide as the memory x.
Condensed: the states are eliminated; what remains is one system in the controls of all B blocks
(B = N where each is a sample), which has nothing of a window but the states s of the window form
(`window_form`), at p samples of theirs:

    sensitivities ∂s_k/∂u     ns · p · nu · B · N/2
    curvature along them      p² · nu · B · N/2 + p · nu² · B² · N/6
    Cholesky factors          nu³ · B³/6
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from msnn.features.control.problem.optimal_control.problem import ControlProblem
from msnn.features.control.problem.optimal_control.window_form import WindowForm, window_form

Chosen = Literal["staged", "condensed"]


@dataclass(frozen=True, slots=True)
class ProductEstimate:
    """Multiplications per iteration, without the derivatives, for each structure."""

    staged: int
    condensed: int
    states: int
    """Of the window form."""

    @property
    def least(self) -> Chosen:
        """The structure with fewer products."""
        # a tie goes to the recursion, whose memory grows with N and not with its square
        return "condensed" if self.condensed < self.staged else "staged"


def chosen_structure(problem: ControlProblem) -> Chosen:
    """The structure that the spec asks for, or the one that costs less."""
    if problem.structure == "auto":
        return estimate(problem).least
    return problem.structure


def estimate(problem: ControlProblem) -> ProductEstimate:
    """Counts the products of each structure for a problem; weights make no difference."""
    form = window_form(problem)
    n, nx, nu = problem.horizon, problem.states.size, problem.controls.size
    # products of a Riccati step: Aᵀ P A and its sides, the factor of nu, and the gains
    staged = n * (nx * (nx + nu) * (2 * nx + nu) + nu**3 // 3 + nu * nx * (nx + nu))
    return ProductEstimate(staged, _condensed(problem, form), form.states)


def numbers_of(problem: ControlProblem, structure: Chosen) -> int:
    """The approximate number of values that a controller stores besides activations and weights."""
    n, nx, nu = problem.horizon, problem.states.size, problem.controls.size
    paths = sum(problem.type(path.value).size for path in problem.path_limits)
    # both sides of each limit keep slack, multiplier, excess, the excess's multiplier and steps of
    # these
    sides = 12 * (nu + paths)
    if structure == "staged":
        width = nx + nu
        return n * (width * width + (nx + 1 + paths) * (width + 1) + (nu + 5) * width + sides)
    states = window_form(problem).states
    series = 2 * (nx + n * (states + nu))
    by_stage = (states + 1 + paths) * (states + nu + 1) + (states + nu) ** 2 + 2 * states + sides
    decided = len(problem.blocks) * nu
    return series + n * by_stage + decided**2 + states * decided * n


def _condensed(problem: ControlProblem, form: WindowForm) -> int:
    n, decided = problem.horizon, len(problem.blocks) * problem.controls.size
    samples = sum(1 for sample in form.memory if not sample.is_control)
    sensitivities = form.states * samples * decided * n // 2
    curvature = samples**2 * decided * n // 2 + samples * decided**2 * n // 6
    return sensitivities + curvature + decided**3 // 6
