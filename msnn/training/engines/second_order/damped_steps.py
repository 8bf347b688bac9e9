"""Minimises a damped quadratic model of the loss, with penalties and priors, or within bounds.

Near given raw variables the total is F + 2gᵀδ + δᵀAδ + P(raw + δ). A step minimises this plus μ ·
δᵀDδ; `levenberg_marquardt` chooses μ. Without P, the step solves (A + μD)δ = −g. With P, it is
computed by accelerated proximal gradient steps (Beck, Teboulle 2009) with restarts when the
objective increases (O'Donoghue, Candès 2015). They use variables scaled by √D, in which the
curvature is about 1 in each direction.

A trial step is the minimum of the damped quadratic model over the box of the bounds: constrained
Levenberg-Marquardt (Kanzow, Yamashita, Fukushima 2004, J. Comput. Appl. Math. 172). A bound is left
as soon as the derivative points inward. Two rules keep a first, too long step from ending on a
wrong face of the box, where other parameters may have no influence left:

- |∂F/∂p| / distance is added to the curvature of each parameter, where the distance is that to the
  bound at which the descent direction points (Coleman, Li 1996, SIAM J. Optim. 6; Branch, Coleman,
  Li 1999, SIAM J. Sci. Comput. 21);
- a bound is reached exactly at the third step in a row that is limited by it; the two before end
  at 90 % of the way.

Weight decay λ is λ/2 · Σ raw²; its gradient λ · raw is what other optimisers add to the gradient. A
prior is ŝ²/n · ((p − mean)/std)², the square of an additional residual of the physical value p.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from backends.known_terms import KnownTerms, approached, corners, deviations
from backends.raw_parameters import Mapping, mapping_of, physical_slope, raw_value
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
    """The bounds of one step, in the scaled variables in which it is computed."""

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
    """Lower and upper bounds of all variables, ±∞ if absent.

    It also counts how many steps in a row each bound has limited.
    """

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
        """The bounds of one step from the variables `at`, in variables divided by `scale`; None
        without bounds.

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
        """The variables after a step, set exactly to a bound if they are within rounding error of
        it.
        """
        trial = at + step
        # at + (bound − at) need not be the bound: the rounding is that of the larger of the two
        rounding = _ROUNDED * (np.abs(at) + np.abs(trial))
        near_low, near_high = trial - self.low <= rounding, self.high - trial <= rounding
        return np.where(near_low, self.low, np.where(near_high, self.high, trial))

    def met(self, at: FloatArray, trial: FloatArray) -> VariableBounds:
        """The same bounds, with updated counts of the steps that they limited, after one from `at`
        to `trial`.
        """
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
    """The parameters as the optimiser sees them: a bounded one has its physical value as the
    variable.

    Bounded parameters get scale 1 and lose their bounds, which `VariableBounds` has. The others are
    unchanged.
    """
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


_MOST_STEPS = 20_000
UNDAMPED = 1e-13
"""Damping that only keeps the equations solvable."""
_SETTLED = 1e-13
"""Relative change of the scaled variables at which the proximal steps stop."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DampedModel:
    """The quadratic model of the total near `raw`, from which steps for any damping are computed.

    Its variables are scaled by 1/√D (see the module); A is stored by its eigenvalues and
    eigenvectors.
    """

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
        """The decrease of the total that the model predicts for a step with almost no damping."""
        return self.undamped.step(UNDAMPED)[1]

    @property
    def undamped(self) -> DampedModel:
        """The model whose steps may go all the way to the bounds.

        It has neither the limits of `StepBox.share` nor the curvature of `StepBox.added`.
        """
        return self if self.box is None else replace(self, box=self.box.whole)

    def lost_corners(self, step: FloatArray) -> float:
        """The decrease of the non-smooth penalties (`l1`, `group`) by a step in raw variables."""
        if not self.known.has_corners:
            return 0.0
        return corners(self.known, self.raw) - corners(self.known, self.raw + step)

    def _at(self, scaled: FloatArray) -> FloatArray:
        """The raw variables after a step; exactly 0 where the step leads to 0."""
        reached = self.raw + scaled * self.scale
        # raw + scaled · scale is rounded, and would miss a kink of a penalty at 0 slightly
        return np.where(scaled == -self.raw / self.scale, 0.0, reached)

    def _to_corners(self, scaled: FloatArray, damping: float) -> FloatArray:
        """The minimum of the damped model with non-smooth penalties, by proximal gradient steps.

        `scaled` is the minimum without penalties, where the iteration starts.
        """
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


@dataclass(frozen=True, slots=True)
class QuadraticTerms:
    """A quadratic near given raw variables: value + 2 slopeᵀδ + Σ curvature · δ²."""

    value: float
    slope: FloatArray
    curvature: FloatArray


def quadratic_terms(
    known: KnownTerms, variables: FloatArray, decay: Decay, spread: float
) -> QuadraticTerms:
    """Priors and weight decay near these variables, as a quadratic; priors are weighted by
    `spread`, ŝ²/n.
    """
    half = 0.5 * decay.factor
    raw, by_variable = decay.raw(variables)
    away, steep = deviations(known, variables)
    return QuadraticTerms(
        value=half * float(raw @ raw) + spread * float(away @ away),
        slope=half * raw * by_variable + spread * away * steep,
        curvature=half * by_variable * by_variable + spread * steep * steep,
    )


@dataclass(frozen=True, slots=True)
class Decay:
    """Weight decay: the term λ/2 Σ raw² of the total.

    Here the variable of a bounded parameter is its physical value, so that `raw` converts it first.
    """

    factor: float
    parameters: Sequence[Parameter]
    """The parameters with their bounds."""

    def raw(self, variables: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The raw value of each variable, and its derivative with respect to the variable."""
        raw, by_variable = variables.copy(), np.ones_like(variables)
        begin = 0
        for parameter in self.parameters if self.factor else ():
            part = slice(begin, begin := begin + len(parameter.initial))
            if mapping_of(parameter) is not Mapping.LINEAR:
                raw[part], _ = raw_value(parameter, variables[part])
                by_variable[part] = 1.0 / physical_slope(parameter, raw[part])
        return raw, by_variable
