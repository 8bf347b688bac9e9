"""Lets a controller fill the tanks along a wanted level, and records every sample."""

import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import numpy as np
import numpy.typing as npt
from plant import NOISE, SAMPLE_TIME, Tanks

import msnn
from msnn.features.control.run.controller import Controller as Predictive
from msnn.features.control.run.method import Solution
from msnn.model.model import Model

Array = npt.NDArray[np.float64]

SAMPLES = 220
LEAK_FROM = 150  # sample at which somebody opens a valve
LEAK = 0.006
START = 2.0  # cm, both levels


def wanted_levels(ahead: int) -> Array:
    """Steps of the wanted lower level [cm], and what follows the end."""
    steps = np.repeat([3.0, 8.0, 5.0, 9.0, 6.0], [20, 50, 40, 60, SAMPLES + ahead - 170])
    return steps.astype(float)


class Controller(Protocol):
    """Anything that turns the measured lower level into a voltage."""

    def decide(self, lower: float, wanted: Array) -> float:
        """The voltage of this sample; `wanted` begins at it."""
        ...


@dataclass
class Pi:
    """A PI controller of the lower level, which stops summing where the pump is at its limit."""

    gain: float  # V/cm
    rate: float  # V/cm/s
    bias: float  # V
    _sum: float = 0.0

    def decide(self, lower: float, wanted: Array) -> float:
        error = wanted[0] - lower
        asked = self.bias + self.gain * error + self._sum
        if 0.0 < asked < 10.0 or asked * error < 0.0:
            self._sum += self.rate * SAMPLE_TIME * error
        return float(np.clip(asked, 0.0, 10.0))


@dataclass
class Mpc:
    """The predictive controller behind its filter, which sees the lower level alone."""

    model: Model
    trained: Path  # folder of a run
    sees_ahead: bool = True  # whether it is told what will be wanted
    rival: bool = False  # whether ipopt solves each problem too
    solves: list[float] = field(default_factory=list[float])  # s
    found: list[Solution] = field(default_factory=list[Solution])
    rivals: list[tuple[float, float, float]] = field(
        default_factory=list[tuple[float, float, float]]
    )  # s, difference of the voltage [V], of the cost by the cost

    def __post_init__(self) -> None:
        self.controller: Predictive = msnn.mpc(self.model, self.trained)
        self.filter = msnn.estimator(self.model, self.trained)
        self.filter.reset({"upper": START, "lower": START, "leak": 0.0})
        self.controller.reset(control={"pump": 0.0})
        self._ipopt = (
            self.controller.casadi("ipopt", {"ipopt.max_iter": 200}) if self.rival else None
        )

    def decide(self, lower: float, wanted: Array) -> float:
        known = self.filter.correct({"lower": lower}).states
        preview = wanted[: self.controller.problem.horizon + 1]
        if not self.sees_ahead:
            preview = np.full_like(preview, wanted[0])
        began = time.perf_counter()
        found = self.controller.solve(
            {name: known[name] for name in ("upper", "lower", "leak")},
            references={"wanted": preview},
        )
        self.solves.append(time.perf_counter() - began)
        if self._ipopt is not None and found.given is not None and found.plan is not None:
            last = self.found[-1].plan if self.found else None
            began = time.perf_counter()
            other = self._ipopt.solve(found.given, last or found.plan)
            taken = time.perf_counter() - began
            apart = abs(float(other.plan.controls[0, 0] - found.plan.controls[0, 0]))
            cost = abs(other.cost - found.cost) / max(1.0, other.cost)
            self.rivals.append((taken, apart, cost))
        self.found.append(found)
        pump = float(found.control["pump"])
        self.filter.predict({"pump": pump})
        return pump


@dataclass(frozen=True)
class Run:
    """What happened at each sample."""

    upper: Array  # cm, without noise
    lower: Array
    pump: Array  # V
    wanted: Array  # cm
    spilt: float  # cm

    @property
    def figures(self) -> dict[str, float]:
        """What README compares."""
        error = self.lower - self.wanted
        return {
            "rms": float(np.sqrt(np.mean(error**2))),
            "mean": float(np.mean(np.abs(error))),
            "leak": float(np.mean(np.abs(error[-30:]))),
            "upper": float(self.upper.max()),
            "spilt": self.spilt,
            "moves": float(np.sum(np.abs(np.diff(self.pump)))),
        }


def run(controller: Controller, seed: int, *, ahead: int = 40) -> Run:
    """The wanted levels from beginning to end, on a rig whose valve is opened on the way."""
    random, rig = np.random.default_rng(seed), Tanks(levels=np.array([START, START]))
    wanted = wanted_levels(ahead)
    rows: list[tuple[float, float, float]] = []
    for sample in range(SAMPLES):
        rig.leaks = LEAK if sample >= LEAK_FROM else 0.0
        seen = float(rig.levels[1]) + NOISE * random.standard_normal()
        pump = controller.decide(seen, wanted[sample:])
        rows.append((float(rig.levels[0]), float(rig.levels[1]), pump))
        rig.step(pump)
    upper, lower, volts = np.array(rows).T
    return Run(upper, lower, volts, wanted[:SAMPLES], rig.spilt)


def tuned(seed: int) -> tuple[float, float]:
    """Gain and rate with the least rms error on the rig itself: better than a user could know."""
    pairs = [(gain, gain / reset) for gain in (0.5, 1.0, 2.0, 3.0, 4.0) for reset in (40, 80, 160)]
    return min(pairs, key=lambda pair: run(Pi(*pair, bias=3.0), seed).figures["rms"])
