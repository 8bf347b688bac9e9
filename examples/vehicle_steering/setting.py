"""Holds every number of the car, its sensors, the roads and the tests; all were chosen beforehand.

None was changed to improve a result. The car itself is vehicle 2, a BMW 320i, of CommonRoad's
package, whose own files have its masses, springs and tyres.
"""

from dataclasses import dataclass

SAMPLE_TIME = 0.05  # s, 20 Hz
SUBSTEPS = 50  # Runge-Kutta steps of the car in a sample: 1 ms
LEAST_SPEED = 2.0  # m/s; below, the stiffness of the wheels' spin explodes and a run is ended


@dataclass(frozen=True)
class Steering:
    """The actuator: the angle of the road wheels follows what is asked for."""

    lag: float = 0.08  # s, of the first order
    rate: float = 0.4  # rad/s at most
    limit: float = 0.6  # rad, of what is asked for


@dataclass(frozen=True)
class Noise:
    """Standard deviations of the sensors, white from sample to sample."""

    speed: float = 0.05  # m/s
    acceleration: float = 0.1  # m/s²
    yaw_rate: float = 0.002  # rad/s
    angle: float = 0.001  # rad, of the road wheels


@dataclass(frozen=True)
class Variation:
    """What differs from the car that telemetry was recorded on."""

    name: str
    mass: float = 1.0  # factor of all masses and inertias of the body
    friction: float = 1.0  # factor of the forces that the tyres can hold
    delay: float = 0.0  # s, of what is asked of the steering


VARIATIONS = (
    Variation("nominal"),
    Variation("mass +10 %", mass=1.1),
    Variation("mass -10 %", mass=0.9),
    Variation("friction 0.8", friction=0.8),
    Variation("delay +20 ms", delay=0.02),
)


@dataclass(frozen=True)
class Roads:
    """Bounds within which roads are drawn."""

    sideways: float  # m/s², what the speed profile allows in a bend
    bends: int
    seed: int
    sharpest: float = 0.045  # 1/m
    widest: float = 0.004
    turn: tuple[float, float] = (0.4, 1.7)  # rad, the heading that a bend adds
    entry: tuple[float, float] = (1.2, 3.0)  # s, that a clothoid into a bend or out of it takes
    straight: tuple[float, float] = (10.0, 60.0)  # m, between bends
    fastest: float = 24.0  # m/s
    slowest: float = 8.0
    speeding: float = 1.5  # m/s², along the road
    braking: float = 2.0


_LIMITS = (4.0, 4.0, 3.5, 4.0, 3.0, 4.0, 2.0, 4.0, 3.5, 4.0)  # m/s², of the training roads
TRAINING = tuple(Roads(sideways=a, bends=12, seed=100 + i) for i, a in enumerate(_LIMITS))
VALIDATION = tuple(Roads(sideways=a, bends=12, seed=200 + i) for i, a in enumerate((4.0, 3.0)))
TEST = Roads(sideways=5.0, bends=16, seed=300)

WAVES = 0.005  # rad at 10 m/s, on the steering of training and validation drives
REAR_SLIP = 1 / (9.81 * 21.92)  # rad s²/m: a tyre's slip stiffness over its load, of the package
