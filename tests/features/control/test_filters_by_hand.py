"""Extended Kalman filters beside filters written by hand in numpy: nothing is shared."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tests.features.control.specs import kalman_filter, load

Array = NDArray[np.float64]
Function = Callable[[Array], Array]

TANKS = """
msnn: 1
name: tanks
sample_time: 2 s
inputs: {pump: {between: hold}}
states:
  upper: {der: 0.3 * pump - 0.4 * sqrt(upper) + leak, init: upper.meas}
  lower: {der: 0.4 * sqrt(upper) - 0.3 * sqrt(lower), init: lower.meas}
  leak: {next: leak, init: 0}
integrator: rk4
outputs:
  head: {expr: sqrt(upper + lower), predicts: "gauge[t]"}
  low: {expr: lower + 0.1 * pump, predicts: "seen[t]"}
targets: {gauge: {}, seen: {}}
estimator:
  ekf:
    measured: {head: 0.05, low: 0.1}
    process: {upper: 0.02, lower: 0.03, leak: 0.01}
    initial: {upper: 0.5, lower: 0.4, leak: 0.2}
"""
"""`leak` is a disturbance that nobody measures: a state that only noise moves."""

JOINTS = """
msnn: 1
name: joints
sample_time: 0.1 s
dims: {joint: 2}
inputs: {torque: {dims: joint, between: linear}}
states:
  angle: {dims: joint, der: rate, init: angle.meas}
  rate: {dims: joint, der: torque - 4 * sin(angle) - 0.3 * rate, init: rate.meas}
integrator: rk4
outputs: {tip: {expr: sin(angle), predicts: "seen[t]"}}
targets: {seen: {dims: joint}}
estimator:
  ekf:
    measured: {tip: 0.02}
    process: {angle: 0.01, rate: 0.2}
    initial: {angle: 0.3, rate: 1}
"""


def jacobian(of: Callable[[NDArray[np.complex128]], NDArray[np.complex128]], x: Array) -> Array:
    """By imaginary steps, which lose no digits."""
    step = 1e-30
    columns = [of(x + 1j * step * one).imag / step for one in np.eye(len(x))]
    return np.array(columns).T


class ByHand:
    """Covariances by the textbook: P = (I - K C) P and A P A' + Q."""

    def __init__(self, x: Array, deviations: list[float], q: list[float], sample: float) -> None:
        self.x, self.covariance = x, np.diag(np.square(deviations))
        # process noise grows with the root of time
        self._q = np.diag(np.square(q)) * sample

    def correct(self, seen: Array, of: Callable[..., NDArray[np.complex128]], r: Array) -> None:
        slopes, wanted = jacobian(of, self.x), of(self.x.astype(complex)).real
        known = ~np.isnan(seen)
        slopes, off, noise = slopes[known], (seen - wanted)[known], np.diag(np.square(r[known]))
        gain = (
            self.covariance @ slopes.T @ np.linalg.inv(slopes @ self.covariance @ slopes.T + noise)
        )
        self.x = self.x + gain @ off
        self.covariance = (np.eye(len(self.x)) - gain @ slopes) @ self.covariance

    def predict(self, of: Callable[..., NDArray[np.complex128]]) -> None:
        A = jacobian(of, self.x)
        self.x = of(self.x.astype(complex)).real
        self.covariance = A @ self.covariance @ A.T + self._q


def stepped(
    der: Callable[..., NDArray[np.complex128]], h: float
) -> Callable[..., NDArray[np.complex128]]:
    """One step by Runge and Kutta, of a right-hand side of x and the part of the sample."""

    def of(x: NDArray[np.complex128]) -> NDArray[np.complex128]:
        k1 = der(x, 0.0)
        k2 = der(x + h / 2 * k1, 0.5)
        k3 = der(x + h / 2 * k2, 0.5)
        return x + h / 6 * (k1 + 2 * k2 + 2 * k3 + der(x + h * k3, 1.0))

    return of


def test_a_disturbance_that_nobody_measures_is_found_as_by_hand(tmp_path: Path) -> None:
    own = kalman_filter(load(tmp_path, TANKS))
    own.reset({"upper": 2.0, "lower": 1.5})
    other = ByHand(np.array([2.0, 1.5, 0.0]), [0.5, 0.4, 0.2], [0.02, 0.03, 0.01], 2.0)
    random, true = np.random.default_rng(5), np.array([2.3, 1.2, -0.15])
    for t in range(60):
        pump = 2.5 + np.sin(0.3 * t)

        def seen_of(x: NDArray[np.complex128], pump: float = pump) -> NDArray[np.complex128]:
            return np.array([np.sqrt(x[0] + x[1]), x[1] + 0.1 * pump])

        def der(x: NDArray[np.complex128], _: float, pump: float = pump) -> NDArray[np.complex128]:
            flow = 0.4 * np.sqrt(x[0])
            return np.array([0.3 * pump - flow + x[2], flow - 0.3 * np.sqrt(x[1]), 0 * x[2]])

        noise = np.array([0.05, 0.1])
        seen = seen_of(true.astype(complex)).real + noise * random.normal(size=2)
        if t % 4 == 1:
            seen[t % 2] = np.nan
        found = own.correct({"gauge": seen[0], "seen": seen[1]}, {"pump": pump})
        other.correct(seen, seen_of, noise)
        names = ("upper", "lower", "leak")
        np.testing.assert_allclose([found.states[n] for n in names], other.x, rtol=1e-9)
        np.testing.assert_allclose(own.covariance, other.covariance, rtol=1e-8, atol=1e-14)
        own.predict({"pump": pump})
        other.predict(stepped(der, 2.0))
        true = stepped(der, 2.0)(true.astype(complex)).real
    assert abs(other.x[2] + 0.15) < 0.05


def test_vectors_and_inputs_on_straight_lines_are_filtered_as_by_hand(tmp_path: Path) -> None:
    own = kalman_filter(load(tmp_path, JOINTS))
    own.reset({"angle": [0.2, -0.1], "rate": [0.0, 0.3]})
    other = ByHand(np.array([0.2, -0.1, 0.0, 0.3]), [0.3, 0.3, 1, 1], [0.01, 0.01, 0.2, 0.2], 0.1)
    random, true = np.random.default_rng(6), np.array([0.4, 0.1, -0.2, 0.1])

    def seen_of(x: NDArray[np.complex128]) -> NDArray[np.complex128]:
        return np.sin(x[:2])

    for t in range(40):
        now, then = (2 * np.sin(0.2 * (t + i) + np.array([0, 1])) for i in (0, 1))

        def der(
            x: NDArray[np.complex128], part: float, now: Array = now, then: Array = then
        ) -> NDArray[np.complex128]:
            torque = now + part * (then - now)
            return np.concatenate([x[2:], torque - 4 * np.sin(x[:2]) - 0.3 * x[2:]])

        seen = np.sin(true[:2]) + 0.02 * random.normal(size=2)
        if t % 5 == 2:
            seen[t % 2] = np.nan
        found = own.correct({"seen": seen})
        other.correct(seen, seen_of, np.full(2, 0.02))
        estimate = np.concatenate([np.ravel(found.states[n]) for n in ("angle", "rate")])
        np.testing.assert_allclose(estimate, other.x, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(own.covariance, other.covariance, rtol=1e-8, atol=1e-14)
        own.predict({"torque": np.array([now, then]).T})
        other.predict(stepped(der, 0.1))
        true = stepped(der, 0.1)(true.astype(complex)).real
