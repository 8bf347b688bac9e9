"""Lets a controller steer a car along a road, and records every sample."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from typing import Protocol

import numpy as np
import numpy.typing as npt
from multi_body import Car, Motion
from preview import Place, Planner, Preview, locate
from roads import Road
from setting import SAMPLE_TIME, Noise

Array = npt.NDArray[np.float64]

END = 60.0  # m, of road left when a run is over
LOST = 20.0  # m beside the road at which a run is over too


@dataclass(frozen=True)
class Seen:
    """What a controller is told at a sample: noisy sensors, the pose, the planned path."""

    speed: float  # m/s
    acceleration: float  # m/s²
    yaw_rate: float  # rad/s
    place: Place
    heading: float  # rad, of the car relative to the road
    path: Preview


class Controller(Protocol):
    """Anything that turns what is seen into an angle of the road wheels [rad]."""

    def start(self, seen: Seen) -> None:
        """Forgets what was before."""
        ...

    def steer(self, seen: Seen) -> float:
        """The angle to ask for."""
        ...


@dataclass(frozen=True)
class Run:
    """What happened at each sample of a run."""

    x: Array  # m
    y: Array
    way: Array  # m, along the road
    offset: Array  # m, to the left of its middle
    curvature: Array  # 1/m, yaw rate over speed, without noise
    wanted: Array  # 1/m, the road's at the car
    asked: Array  # rad, by the controller
    angle: Array  # rad, of the road wheels, as measured
    speed: Array  # m/s, as measured
    acceleration: Array  # m/s², as measured
    yaw_rate: Array  # rad/s, as measured
    arrived: bool

    @property
    def steering_rate(self) -> Array:
        """Slope of the angle asked for [rad/s]."""
        return np.diff(self.asked) / SAMPLE_TIME


class Pedals:
    """A PI controller of the speed, beside the acceleration that the speed profile has."""

    GAIN, RATE = 1.5, 0.3  # 1/s, 1/s²

    def __init__(self) -> None:
        self._sum = 0.0

    def push(self, road: Road, way: float, speed: float) -> float:
        """The acceleration to ask for [m/s²]."""
        v = float(road.at(way, road.speed))
        ahead = float(road.at(way + 1.0, road.speed))
        error = v - speed
        self._sum += SAMPLE_TIME * error
        return v * (ahead - v) + self.GAIN * error + self.RATE * self._sum


def run(
    car: Car,
    controller: Controller,
    road: Road,
    seed: int,
    planner_of: Callable[[Road, float], Planner] = Planner,
) -> Run:
    """From the beginning of the road to its end, or until the car is lost."""
    random, pedals = np.random.default_rng(seed), Pedals()
    motion = car.start(road.x[0], road.y[0], road.heading[0], float(road.speed[0]))
    place = locate(road, motion, 0.0)
    planner = planner_of(road, car.wheelbase - car.to_front)
    rows: list[tuple[float, ...]] = []
    while place.way < road.way[-1] - END and abs(place.offset) < LOST:
        sensors = _measured(motion, random)
        place = locate(road, motion, place.way)
        path = planner.plan(place, sensors)
        turned = place.turned + motion.heading - motion.course
        seen = Seen(
            sensors["speed"], sensors["acceleration"], sensors["yaw_rate"], place, turned, path
        )
        if not rows:
            controller.start(seen)
        asked = controller.steer(seen)
        here = (motion.x, motion.y, place.way, place.offset, motion.curvature, place.curvature)
        measured = ("angle", "speed", "acceleration", "yaw_rate")
        rows.append((*here, asked, *(sensors[name] for name in measured)))
        motion = car.step(asked, pedals.push(road, place.way, sensors["speed"]))
    names = [entry.name for entry in fields(Run)][:-1]
    columns = dict(zip(names, np.array(rows).T, strict=True))
    return Run(**columns, arrived=bool(abs(place.offset) < LOST))


def _measured(motion: Motion, random: np.random.Generator) -> Mapping[str, float]:
    """The sensors' values, each with its noise."""
    noise = Noise()
    deviations = {entry.name: float(getattr(noise, entry.name)) for entry in fields(Noise)}
    return {
        name: float(getattr(motion, name)) + deviation * random.standard_normal()
        for name, deviation in deviations.items()
    }
