"""Finds the least of a damped model of the total, with penalties that have corners or without.

Near some raw variables the total is F + 2gᵀδ + δᵀAδ + P(raw + δ). A step minimises that and
μ · δᵀDδ beside it. Without P it solves (A + μD)δ = −g. With P it is found by accelerated proximal
steps (Beck, Teboulle 2009) that start again where they turn uphill (O'Donoghue, Candès 2015), in
variables scaled by √D, whose curvature is about 1 in each direction.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from backends.known_terms import KnownTerms, approached, corners
from msnn.data.dataset import FloatArray
from msnn.training.engines.second_order.bounded_steps import StepBox, box_step

_MOST_STEPS = 20_000
UNDAMPED = 1e-13
"""Damping that only keeps equations solvable."""
_SETTLED = 1e-13
"""Relative change of the scaled variables at which the proximal steps end."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DampedModel:
    """The model in variables scaled by 1/√D."""

    total: float
    raw: FloatArray
    """Where it was made."""
    scale: FloatArray
    """1/√D."""
    slope: FloatArray
    curvatures: FloatArray
    """Eigenvalues of A, none below 0."""
    directions: FloatArray
    """Their eigenvectors, in columns."""
    known: KnownTerms
    box: StepBox | None = None
    """The limits of the step; None without bounds."""

    def step(self, damping: float) -> tuple[FloatArray, float]:
        """The step in raw variables at this damping, and how much the model falls by it."""
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
        """The step within the bounds, and the fall of the model without what bounds add."""
        curvature = (self.directions * self.curvatures) @ self.directions.T
        scaled = box_step(curvature + damping * np.eye(len(curvature)), self.slope, box)
        fall = -float(2.0 * self.slope @ scaled + scaled @ curvature @ scaled)
        return scaled * self.scale, fall

    def promise(self) -> float:
        """The fall of the model by its almost undamped step."""
        return self.undamped.step(UNDAMPED)[1]

    @property
    def undamped(self) -> DampedModel:
        """The model with its bounds alone."""
        return self if self.box is None else replace(self, box=self.box.whole)

    def lost_corners(self, step: FloatArray) -> float:
        """The fall of the penalties by a step in raw variables."""
        if not self.known.has_corners:
            return 0.0
        return corners(self.known, self.raw) - corners(self.known, self.raw + step)

    def _at(self, scaled: FloatArray) -> FloatArray:
        """Raw variables, exactly 0 where the step leads there."""
        reached = self.raw + scaled * self.scale
        # raw + scaled · scale rounds, and would leave what is on a corner a little beside it
        return np.where(scaled == -self.raw / self.scale, 0.0, reached)

    def _to_corners(self, scaled: FloatArray, damping: float) -> FloatArray:
        """The least of the damped model with its corners, from the one without."""
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
