"""What sample programs are made of: a program with a log that fits it, units, smooth series."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from compiler.ir.program import Program
from compiler.ir.types import WINDOW, Axis
from spec_schema.units.parser import parse_unit

Log = dict[str, NDArray[np.float64]]

METRE, NEWTON, SECOND = parse_unit("m"), parse_unit("N"), parse_unit("s")
SPEED, RADIAN = parse_unit("m/s"), parse_unit("rad")
TORQUE = parse_unit("N*m")


@dataclass(frozen=True)
class Sample:
    """A program, the inputs that its outputs can close, and its logs: (rows, seed) -> log."""

    program: Program
    closed: tuple[str, ...]
    log: Callable[[int, int], Log]


def taps(count: int) -> tuple[Axis, ...]:
    return (Axis(WINDOW, count),)


def wave(rows: int, seed: int, *shape: int) -> NDArray[np.float64]:
    """A smooth series with a little noise, within about ±1.5."""
    random = np.random.default_rng(seed)
    t = np.arange(rows).reshape(-1, *(1 for _ in shape))
    phase = random.uniform(0, 6, (1, *shape))
    return (
        np.sin(0.07 * t + phase)
        + 0.4 * np.cos(0.31 * t + 2 * phase)
        + random.normal(0, 0.05, (rows, *shape))
    )
