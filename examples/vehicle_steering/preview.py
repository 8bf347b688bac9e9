"""Plans, at every sample, a path from where the car is back to the middle of the road.

The offset n from the middle is a polynomial of the fifth degree in time. It begins with the car's
offset and the slope that its course gives it, and ends after 3 s with n, its slope and its second
slope at 0 (Werling et al., Optimal Trajectory Generation for Dynamic Street Scenarios in a Frenét
Frame, ICRA 2010). A pose has no second slope: that begins as the plan of the sample before has it
by now. Were it 0 each time, no plan would ever get beyond its first, straightest moments.

What is handed on is the curvature that the car's yaw rate has to have. It differs from that of the
path by the rate of the side slip, which in a steady bend is (distance to the rear axle · curvature
- slip of the rear axle). That of the road is taken: the plan's own would feed the car's movements
back once more.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from multi_body import Motion
from roads import Road
from setting import REAR_SLIP, SAMPLE_TIME

Array = npt.NDArray[np.float64]

RETURN = 3.0  # s, until the path is in the middle
LOOK = 30  # samples of the path that a controller sees, the first of them now
_AHEAD = SAMPLE_TIME * np.arange(LOOK)


@dataclass(frozen=True)
class Place:
    """Where a car is relative to a road."""

    way: float  # m, along it
    offset: float  # m, to the left of its middle
    turned: float  # rad, the course relative to the road
    curvature: float  # 1/m, of the road


@dataclass(frozen=True)
class Preview:
    """The planned path: what yaw rate over speed has to be, and the speed, now and next."""

    curvature: Array  # 1/m
    speed: Array  # m/s


def locate(road: Road, motion: Motion, near: float) -> Place:
    """The foot of the perpendicular to the road, near a former one."""
    way = near
    for _ in range(4):
        heading = float(road.at(way, road.heading))
        along, left = _in_frame(road, motion, way, heading)
        way += along / (1.0 - left * float(road.at(way, road.curvature)))
    heading = float(road.at(way, road.heading))
    turned = (motion.course - heading + np.pi) % (2 * np.pi) - np.pi
    _, left = _in_frame(road, motion, way, heading)
    return Place(way, left, turned, float(road.at(way, road.curvature)))


class Planner:
    """Plans paths along a road, for a car whose centre is so far ahead of its rear axle."""

    def __init__(self, road: Road, to_rear: float) -> None:
        self._road, self._to_rear = road, to_rear
        self._second_slope = 0.0  # m/s², of the offset, as the last plan has it a sample later

    def plan(self, place: Place, sensors: Mapping[str, float]) -> Preview:
        """The path from a place, with the measured speed; the next one is asked a sample later."""
        road = self._road
        slope = sensors["speed"] * np.sin(place.turned)
        n, dn, ddn = _offsets(place.offset, slope, self.second_slope(place, sensors))
        self._second_slope = float(ddn[1])
        way = np.interp(road.at(place.way, road.time) + _AHEAD, road.time, road.way)
        v, k, dk = road.at(way, road.speed), road.at(way, road.curvature), road.at(way, road.slope)
        dv = v * np.gradient(v, way)  # acceleration of the speed profile
        # velocity and acceleration in the frame that goes along the middle of the road
        forth, left = v * (1.0 - k * n), dn
        forth_slope = dv * (1.0 - k * n) - v * (dk * v * n + k * dn) - left * k * v
        left_slope = ddn + forth * k * v
        curvature = (forth * left_slope - left * forth_slope) / (forth**2 + left**2) ** 1.5
        slip = (self._to_rear - REAR_SLIP * v**2) * k
        return Preview(curvature - np.gradient(slip, SAMPLE_TIME) / v, v)

    def second_slope(self, place: Place, sensors: Mapping[str, float]) -> float:
        """That of the offset, where a plan begins [m/s²]."""
        return self._second_slope


def _offsets(n: float, dn: float, ddn: float) -> tuple[Array, Array, Array]:
    """The polynomial with its first and second slope, over the samples that are seen."""
    T, s = RETURN, _AHEAD
    c3 = -(10 * n + 6 * dn * T + 3 / 2 * ddn * T**2) / T**3
    c4 = (15 * n + 8 * dn * T + 3 / 2 * ddn * T**2) / T**4
    c5 = -(6 * n + 3 * dn * T + 1 / 2 * ddn * T**2) / T**5
    return (
        n + dn * s + ddn / 2 * s**2 + c3 * s**3 + c4 * s**4 + c5 * s**5,
        dn + ddn * s + 3 * c3 * s**2 + 4 * c4 * s**3 + 5 * c5 * s**4,
        ddn + 6 * c3 * s + 12 * c4 * s**2 + 20 * c5 * s**3,
    )


def _in_frame(road: Road, motion: Motion, way: float, heading: float) -> tuple[float, float]:
    """Where the car is, seen from a point of the road: ahead of it and to its left [m]."""
    dx = motion.x - float(road.at(way, road.x))
    dy = motion.y - float(road.at(way, road.y))
    return (
        dx * np.cos(heading) + dy * np.sin(heading),
        dy * np.cos(heading) - dx * np.sin(heading),
    )
