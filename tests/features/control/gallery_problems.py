"""Control problems whose plants are specs of the gallery, and what each is solved from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

import msnn
from msnn.model.model import Model

GALLERY = Path(__file__).parents[3] / "examples" / "gallery"


@dataclass(frozen=True)
class GalleryProblem:
    """An `mpc` section, and the first measurement."""

    mpc: str
    x: Mapping[str, ArrayLike]
    references: Mapping[str, ArrayLike] = field(default_factory=dict[str, ArrayLike])
    disturbances: Mapping[str, ArrayLike] = field(default_factory=dict[str, ArrayLike])

    def model(self, name: str, folder: Path) -> Model:
        """The spec of the gallery with this section."""
        text = (GALLERY / f"{name}.msnn.yaml").read_text(encoding="utf-8")
        path = folder / f"{name}.msnn.yaml"
        path.write_text(f"{text}\n{self.mpc}", encoding="utf-8")
        return msnn.load(path)


PROBLEMS = {
    "two_tanks": GalleryProblem(
        """
mpc:
  horizon: 20
  controls: [pump]
  references: {level: {unit: cm, preview: true}}
  cost:
    stage: (lower - level)**2 + 0.1 * (pump - pump[t-1])**2
    terminal: 10 * (lower - level)**2
  bounds: {pump: {min: 0, max: 10 V, rate: 0.5 V/s}, upper: {max: 60 mm}}
""",
        {"upper": 2.0, "lower": 3.0},
        {"level": np.linspace(6.0, 4.0, 21)},
    ),
    "cart_pole": GalleryProblem(
        """
mpc:
  horizon: 25
  controls: [force]
  cost:
    stage: 10 * (cos(angle) + 1)**2 + x**2 + 0.01 * force**2
    terminal: 100 * (cos(angle) + 1)**2 + 5 * rate**2
  bounds: {force: {min: -10, max: 10}, x: {min: -0.2, max: 0.2}}
""",
        {"x": 0.15, "speed": 0.0, "angle": 2.9, "rate": 0.0},
    ),
    "motor": GalleryProblem(
        """
mpc:
  horizon: 20
  controls: [voltage]
  references: {wanted: rad/s}
  cost: ((speed - wanted) / 100)**2 + 0.001 * voltage**2
  bounds: {voltage: {min: -24, max: 24}, current: {min: -12, max: 12}}
""",
        {"current": 0.0, "speed": 0.0},
        {"wanted": 300.0},
    ),
    "heater": GalleryProblem(
        """
mpc:
  horizon: 30
  controls: [duty]
  cost: ((oven - wanted) / 10)**2 + 0.1 * duty**2
  bounds: {duty: {min: 0, max: 1}, oven: {max: wanted_most}}
  references: {wanted_most: {}}
""",
        {"oven": 40.0},
        {"wanted_most": 82.0},
        {"wanted": 80.0},
    ),
    "reference": GalleryProblem(
        """
mpc:
  horizon: 20
  controls: [u]
  references: {wanted: {unit: m/s, preview: true}}
  cost: (v - wanted)**2 + 0.01 * (u - u[t-1])**2
  bounds: {u: {min: -20, max: 20, rate: 80}, v: {max: 9.5}}
""",
        {"v": 3.0},
        {"wanted": np.linspace(5.0, 10.0, 21)},
    ),
    "arm_friction": GalleryProblem(
        """
mpc:
  horizon: 12
  controls: [torque]
  references: {wanted: {unit: rad/s, dims: joint}}
  cost:
    stage: sum((rate - wanted)**2) + 0.001 * sum(torque**2)
    terminal: 5 * sum((rate - wanted)**2)
  bounds: {torque: {min: -20, max: 20}, effort: {max: 15, soft: {linear: 1, quadratic: 1}}}
  blocks: [1, 2, 3, 6]
""",
        {"rate": [0.5, -0.2, 0.0]},
        {"wanted": [1.0, 0.5, -1.0]},
    ),
    "battery": GalleryProblem(
        """
mpc:
  horizon: 30
  controls: [current]
  references: {power: {}}
  cost: (voltage_now * current - power)**2 + 0.01 * current**2
  bounds: {current: {min: -5, max: 10}, voltage_now: {min: 3.0}}
""",
        {"charge": 0.2},
        {"power": 30.0},
        {"warmth": 290.0},
    ),
    "quarter_car": GalleryProblem(
        """
mpc:
  horizon: 20
  controls: [road]
  references: {wanted: m}
  cost: {stage: 1e4 * (z - wanted)**2 + 100 * road**2, terminal: 1e4 * (z - wanted)**2}
  bounds: {road: {min: -0.1, max: 0.1, rate: 2 m/s}, travel: {min: -0.05, max: 0.05}}
""",
        {"z": 0.0, "dz": 0.0, "w": 0.0, "dw": 0.0},
        {"wanted": 0.05},
    ),
}
