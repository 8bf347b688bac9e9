"""Minimises a damped quadratic model of the loss, with optional non-smooth penalties.

Near given raw variables the total is F + 2gᵀδ + δᵀAδ + P(raw + δ). A step minimises this plus μ ·
δᵀDδ. Without P, the step solves (A + μD)δ = −g. With P, it is computed by accelerated proximal
gradient steps (Beck, Teboulle 2009) with restarts when the objective increases (O'Donoghue, Candès
2015). They use variables scaled by √D, in which the curvature is about 1 in each direction.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from backends.known_terms import KnownTerms, approached, corners
from msnn.data.dataset import FloatArray
from msnn.training.engines.second_order.bounded_steps import StepBox, box_step

_MOST_STEPS = 20_000
UNDAMPED = 1e-13
"""Damping that only keeps the equations solvable."""
_SETTLED = 1e-13
"""Relative change of the scaled variables at which the proximal steps stop."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DampedModel:
    """The quadratic model in variables scaled by 1/√D."""

    total: float
    raw: FloatArray
    """The raw variables at which the model was built."""
    scale: FloatArray
    """1/√D."""
    slope: FloatArray
    curvatures: FloatArray
    """Eigenvalues of A, all ≥ 0."""
    directions: FloatArray
    """The eigenvectors, as columns."""
    known: KnownTerms
    box: StepBox | None = None
    """The limits of the step; None without bounds."""

    def step(self, damping: float) -> tuple[FloatArray, float]:
        """The step in raw variables for this damping, and the predicted decrease of the model."""
        if self.box is not None and not self.known.has_corners:
            return self._within(self.box, damping)
        along = -(self.directions.T @ self.slope) / (self.curvatures + damping)
        if not self.known.has_corners:
            # −2gᵀδ − δᵀAδ with g = −(A + μ)δ: a sum of squares, where the difference would cancel
            fall = float(np.sum(along * along * (self.curvatures + 2.0 * damping)))
            return (self.directions @ along) * self.scale, fall
        trial = self._to_corners(self.directions @ along, damping)
        along = self.directions.T @ trial
        bent = float(2.0 * self.slope @ trial + np.sum(self.curvatures * along * along))
        step = self._at(trial) - self.raw
        return step, self.lost_corners(step) - bent

    def _within(self, box: StepBox, damping: float) -> tuple[FloatArray, float]:
        """The step within the bounds, and the decrease of the model without the term of the
        bounds.
        """
        curvature = (self.directions * self.curvatures) @ self.directions.T
        scaled = box_step(curvature + damping * np.eye(len(curvature)), self.slope, box)
        fall = -float(2.0 * self.slope @ scaled + scaled @ curvature @ scaled)
        return scaled * self.scale, fall

    def promise(self) -> float:
        """The predicted decrease of an almost undamped step."""
        return self.undamped.step(UNDAMPED)[1]

    @property
    def undamped(self) -> DampedModel:
        """The model whose steps may go all the way to the bounds.

        It has neither the limits of `StepBox.share` nor the curvature of `StepBox.added`.
        """
        return self if self.box is None else replace(self, box=self.box.whole)

    def lost_corners(self, step: FloatArray) -> float:
        """The decrease of the penalties by a step in raw variables."""
        if not self.known.has_corners:
            return 0.0
        return corners(self.known, self.raw) - corners(self.known, self.raw + step)

    def _at(self, scaled: FloatArray) -> FloatArray:
        """The raw variables after a step; exactly 0 where the step leads to 0."""
        reached = self.raw + scaled * self.scale
        # raw + scaled · scale is rounded, and would miss a kink of a penalty at 0 slightly
        return np.where(scaled == -self.raw / self.scale, 0.0, reached)

    def _to_corners(self, scaled: FloatArray, damping: float) -> FloatArray:
        """The minimum of the damped model with penalties, starting from the one without."""
        steepest = float(self.curvatures.max(initial=0.0)) + damping
        # 1/L of a gradient 2(Aδ + g), in raw variables, in which the penalties are written
        lengths = self.scale * self.scale / (2.0 * steepest)
        origin = self.raw / self.scale

        def downhill(at: FloatArray) -> FloatArray:
            along = (self.curvatures + damping) * (self.directions.T @ (at - origin))
            forward = at - (self.directions @ along + self.slope) / steepest
            reached = approached(self.known, forward * self.scale, lengths, 0.0)
            reached = np.where(reached == 0.0, 0.0, reached / self.scale)
            if self.box is None:
                return reached
            # no variable has both a corner and a bound
            return np.clip(reached, origin + self.box.low, origin + self.box.high)

        now = ahead = origin + scaled
        speed = 1.0
        for _ in range(_MOST_STEPS):
            following = downhill(ahead)
            if float((ahead - following) @ (following - now)) > 0.0:
                speed, following = 1.0, downhill(now)
            change, before = following - now, speed
            speed = 0.5 * (1.0 + np.sqrt(1.0 + 4.0 * speed * speed))
            now, ahead = following, following + (before - 1.0) / speed * change
            if float(np.abs(change).max()) <= _SETTLED * (1.0 + float(np.abs(now).max())):
                break
        return np.where(now == 0.0, -origin, now - origin)
