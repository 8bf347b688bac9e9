"""Keeps the steps of least squares within the bounds of the parameters, in physical units.

A trial step is the minimum of the damped quadratic model over the box of the bounds: constrained
Levenberg-Marquardt (Kanzow, Yamashita, Fukushima 2004, J. Comput. Appl. Math. 172). A bound is left
as soon as the derivative points inward. Two rules keep a first, too long step from ending on a
wrong face of the box, where other parameters may have no influence left:

- |∂F/∂p| / distance is added to the curvature of each parameter, where the distance is that to the
  bound at which the descent direction points (Coleman, Li 1996, SIAM J. Optim. 6; Branch, Coleman,
  Li 1999, SIAM J. Sci. Comput. 21);
- a bound is reached exactly at the third step in a row that is limited by it; the two before end
  at 90 % of the way.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from compiler.ir.program import Parameter
from msnn.data.dataset import FloatArray

_SHARE_OF_WAY = 0.9
"""Fraction of the way to a bound that the first steps limited by it take."""
_CONTACTS = 2
"""Number of successive steps limited by a bound before a step ends on the bound."""
_ROUNDED = 4.0 * np.finfo(float).eps
_INWARD = 1e-12
"""Derivative, relative to the largest, above which a variable leaves its bound within a step."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StepBox:
    """Limits of a step in scaled variables, and the curvature added by the bounds."""

    low: FloatArray
    high: FloatArray
    share: FloatArray
    """Fraction of the way to each bound that a step may take: (2, variables)."""
    added: FloatArray
    """The term of Coleman and Li, |∂F/∂p|/distance."""

    @property
    def whole(self) -> StepBox:
        """The same bounds, which a step may reach at once; without the added curvature."""
        return replace(self, share=np.ones_like(self.share), added=np.zeros_like(self.added))


@dataclass(frozen=True, slots=True, kw_only=True)
class VariableBounds:
    """The bounds of all variables (infinite if absent), and counts of steps that they limited."""

    low: FloatArray
    high: FloatArray
    contacts: FloatArray
    """Number of successive steps that a bound has limited: (2, variables), lower bound first."""

    @classmethod
    def of(cls, parameters: Sequence[Parameter]) -> VariableBounds:
        """The bounds of all elements of the parameters, one parameter after the other."""
        sizes = [int(np.prod([axis.size for axis in p.axes])) for p in parameters]
        low = [-np.inf if p.minimum is None else p.minimum for p in parameters]
        high = [np.inf if p.maximum is None else p.maximum for p in parameters]
        return cls(
            low=np.repeat(np.array(low), sizes),
            high=np.repeat(np.array(high), sizes),
            contacts=np.zeros((2, sum(sizes))),
        )

    @property
    def some(self) -> bool:
        """True if any variable has a bound."""
        return bool(np.isfinite(self.low).any() or np.isfinite(self.high).any())

    def box(self, at: FloatArray, scale: FloatArray, slope: FloatArray) -> StepBox | None:
        """The box of a step from `at`, in variables divided by `scale`; None without bounds.

        `slope` is half the gradient of the total loss in the scaled variables.
        """
        if not self.some:
            return None
        low, high = (self.low - at) / scale, (self.high - at) / scale
        way = np.where(slope > 0.0, -low, high)
        inside = (way > 0.0) & np.isfinite(way)
        return StepBox(
            low=low,
            high=high,
            share=np.where(self.contacts < _CONTACTS, _SHARE_OF_WAY, 1.0),
            added=np.where(inside, np.abs(slope) / np.where(inside, way, 1.0), 0.0),
        )

    def moved(self, at: FloatArray, step: FloatArray) -> FloatArray:
        """The variables after a step; exactly on a bound if the step leads to it."""
        trial = at + step
        # at + (bound − at) need not be the bound: the rounding is that of the larger of the two
        rounding = _ROUNDED * (np.abs(at) + np.abs(trial))
        near_low, near_high = trial - self.low <= rounding, self.high - trial <= rounding
        return np.where(near_low, self.low, np.where(near_high, self.high, trial))

    def met(self, at: FloatArray, trial: FloatArray) -> VariableBounds:
        """The bounds with the counts updated after a step from `at` to `trial`."""
        share = _SHARE_OF_WAY * (1.0 - 1e-9)
        with np.errstate(invalid="ignore"):
            limited = np.stack(
                [
                    (trial < at) & (at - trial >= share * (at - self.low)),
                    (trial > at) & (trial - at >= share * (self.high - at)),
                ]
            )
        return replace(self, contacts=np.where(limited, self.contacts + 1.0, 0.0))


def in_physical_units(parameters: Sequence[Parameter]) -> list[Parameter]:
    """The parameters; for bounded ones, the variable is the physical value."""
    return [
        replace(p, minimum=None, maximum=None, scale=1.0) if _is_bounded(p) else p
        for p in parameters
    ]


def _is_bounded(parameter: Parameter) -> bool:
    return parameter.minimum is not None or parameter.maximum is not None


def box_step(curvature: FloatArray, slope: FloatArray, box: StepBox) -> FloatArray:
    """The step d within the box that minimises 2 slopeᵀd + dᵀ (curvature + added) d.

    The sum of curvature and `added` is positive definite, and the box contains 0. Method: primal
    active-set from d = 0 (Nocedal, Wright, Numerical Optimization, 2006, algorithm 16.3). Each
    change of the active set costs one solution of the equations for the free variables.
    """
    low, high = box.low * box.share[0], box.high * box.share[1]
    curvature = curvature + np.diag(box.added)
    n = len(slope)
    step = np.zeros(n)
    unit = np.sqrt(np.diagonal(curvature))
    least = _INWARD * float(np.abs(slope / unit).max(initial=0.0))
    fixed = ((low >= 0.0) & (slope > 0.0)) | ((high <= 0.0) & (slope < 0.0))
    for _ in range(20 * n + 20):
        free = np.flatnonzero(~fixed)
        way = np.zeros(n)
        if free.size:
            gradient = slope + curvature @ step
            way[free] = np.linalg.solve(curvature[np.ix_(free, free)], -gradient[free])
        with np.errstate(divide="ignore", invalid="ignore"):
            room = np.where(way > 0.0, (high - step) / way, (low - step) / way)
        room = np.where((way != 0.0) & ~fixed, room, np.inf)
        first = int(np.argmin(room))
        if room[first] < 1.0:
            step = np.clip(step + max(room[first], 0.0) * way, low, high)
            step[first] = high[first] if way[first] > 0.0 else low[first]
            fixed[first] = True
            continue
        step = np.clip(step + way, low, high)
        gradient = slope + curvature @ step
        inward = np.where(step <= low, -gradient, gradient) / unit
        inward = np.where(fixed & (low < high), inward, -np.inf)
        most = int(np.argmax(inward))
        if inward[most] <= least:
            break
        fixed[most] = False
    return step
