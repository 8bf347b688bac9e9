"""Drives a linear single-track car with a steering actuator, in place of the example's own car.

Side slip and yaw rate with tyres that are softer in front (Rajamani, Vehicle Dynamics and Control,
2012, chapter 2), moved on by small Euler steps. It is fast, needs no package, and understeers.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

SAMPLE_TIME = 0.05  # s
FINER = 10  # Euler steps in a sample


@dataclass(frozen=True)
class Shape:
    """Mass [kg], yaw inertia [kg m²], axles from the centre [m], tyres [N/rad]."""

    mass: float = 1500.0
    inertia: float = 2500.0
    front: float = 1.2
    rear: float = 1.5
    front_stiffness: float = 90e3
    rear_stiffness: float = 110e3
    lag: float = 0.08  # s, of the steering


class SingleTrack:
    """The `Car` of the example; `motion` makes its `Motion`."""

    def __init__(self, motion: Callable[..., Any], variation: Any, substeps: int = 50) -> None:
        self._motion, self._shape = motion, Shape()
        self._mass, self._grip = variation.mass, variation.friction
        self._late = round(variation.delay / SAMPLE_TIME * FINER)
        self._finer = FINER * substeps // 50
        self.wheelbase = self._shape.front + self._shape.rear
        self.to_front = self._shape.front
        self._asked, self._push = 0.0, 0.0
        # x, y, heading, side slip, yaw rate, speed, angle of the wheels
        self._state = (0.0,) * 7

    def start(self, x: float, y: float, heading: float, speed: float) -> Any:
        self._state = (x, y, heading, 0.0, 0.0, speed, 0.0)
        self._asked = 0.0
        return self._seen()

    def step(self, asked: float, push: float) -> Any:
        h = SAMPLE_TIME / self._finer
        for step in range(self._finer):
            late = step < self._late * self._finer // FINER
            slopes = self._slopes(self._asked if late else asked, push)
            self._state = tuple(x + h * dx for x, dx in zip(self._state, slopes, strict=True))
        self._asked, self._push = asked, push
        return self._seen()

    def _slopes(self, asked: float, push: float) -> tuple[float, ...]:
        s = self._shape
        _, _, heading, slip, yaw_rate, v, angle = self._state
        front = self._grip * s.front_stiffness * (angle - slip - s.front * yaw_rate / v)
        rear = self._grip * s.rear_stiffness * (-slip + s.rear * yaw_rate / v)
        turn = min(max((asked - angle) / s.lag, -0.4), 0.4)
        sideways = (front + rear) / (self._mass * s.mass * v) - yaw_rate
        moment = (s.front * front - s.rear * rear) / (self._mass * s.inertia)
        course = heading + slip
        return v * math.cos(course), v * math.sin(course), yaw_rate, sideways, moment, push, turn

    def _seen(self) -> Any:
        x, y, heading, slip, yaw_rate, v, angle = self._state
        return self._motion(
            x=x, y=y, heading=heading, course=heading + slip, speed=v, acceleration=self._push,
            yaw_rate=yaw_rate, angle=angle,
        )  # fmt: skip
