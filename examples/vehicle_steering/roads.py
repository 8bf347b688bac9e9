"""Draws roads of straights, clothoids and arcs, with a speed for every place."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from setting import Roads

Array = npt.NDArray[np.float64]

STEP = 0.25  # m, of the tables


@dataclass(frozen=True)
class Road:
    """The middle of a road, and how fast it is driven: tables over the way along it."""

    way: Array  # m
    x: Array
    y: Array
    heading: Array  # rad
    curvature: Array  # 1/m
    speed: Array  # m/s
    time: Array  # s, at which a car that keeps the speeds is there

    @property
    def slope(self) -> Array:
        """How fast the curvature changes along the road [1/m²]."""
        return np.gradient(self.curvature, self.way)

    def at(self, way: float | Array, table: Array) -> Array:
        """A table's value so far along the road."""
        return np.interp(way, self.way, table)


def draw(roads: Roads) -> Road:
    """One road; the same seed gives the same."""
    random = np.random.default_rng(roads.seed)
    pieces = [np.zeros(round(60.0 / STEP))]  # a straight to begin with
    for _ in range(roads.bends):
        sharpness = np.exp(random.uniform(np.log(roads.widest), np.log(roads.sharpest)))
        speed = min(np.sqrt(roads.sideways / sharpness), roads.fastest)
        side = random.choice((-1.0, 1.0))
        ramps = [speed * random.uniform(*roads.entry) for _ in range(2)]
        turn = random.uniform(*roads.turn)
        arc = max(turn / sharpness - sum(ramps) / 2, 5.0)
        pieces += [
            side * np.linspace(0.0, sharpness, round(ramps[0] / STEP), endpoint=False),
            side * np.full(round(arc / STEP), sharpness),
            side * np.linspace(sharpness, 0.0, round(ramps[1] / STEP), endpoint=False),
            np.zeros(round(random.uniform(*roads.straight) / STEP)),
        ]
    pieces.append(np.zeros(round(120.0 / STEP)))
    return _laid_out(np.concatenate(pieces), roads)


def _laid_out(curvature: Array, roads: Roads) -> Road:
    """Integrates a curvature to a road, and finds its speeds."""
    way = STEP * np.arange(curvature.size)
    heading = _summed(curvature)
    speed = _speeds(curvature, roads)
    return Road(
        way=way,
        x=_summed(np.cos(heading)),
        y=_summed(np.sin(heading)),
        heading=heading,
        curvature=curvature,
        speed=speed,
        time=_summed(1.0 / speed),
    )


def _speeds(curvature: Array, roads: Roads) -> Array:
    """As fast as bends allow, and as pedals reach: v² grows by at most 2·a·ds."""
    bends = np.sqrt(roads.sideways / np.maximum(np.abs(curvature), 1e-9))
    squares = np.clip(bends, roads.slowest, roads.fastest) ** 2
    for i in range(1, squares.size):
        squares[i] = min(squares[i], squares[i - 1] + 2 * roads.speeding * STEP)
    for i in range(squares.size - 2, -1, -1):
        squares[i] = min(squares[i], squares[i + 1] + 2 * roads.braking * STEP)
    return np.sqrt(squares)


def _summed(slope: Array) -> Array:
    """The integral by trapezoids, from 0."""
    return np.concatenate(([0.0], np.cumsum(STEP * (slope[1:] + slope[:-1]) / 2)))
