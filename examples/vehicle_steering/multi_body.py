"""Drives CommonRoad's multi-body car: 29 states, tyres by Pacejka, translated to C once."""

import ctypes
import hashlib
import subprocess
import sys
from collections.abc import Callable, Mapping
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
from python_to_c import Translation, translate
from setting import LEAST_SPEED, SAMPLE_TIME, SUBSTEPS, Steering, Variation

Array = npt.NDArray[np.float64]

HERE = Path(__file__).resolve().parent
BODY = ("m", "m_s", "m_uf", "m_ur", "I_Phi_s", "I_y_s", "I_z", "I_uf", "I_ur")
GRIP = ("tire.p_dx1", "tire.p_dy1")
RATES = ("steering.v_min", "steering.v_max")
SLOW = "abs(x[3]) < 0.1"  # the branches for a car that stands, which no run here reaches


@dataclass(frozen=True)
class Motion:
    """What a car does at a sample, without noise."""

    x: float  # m, of the centre of mass
    y: float
    heading: float  # rad
    course: float  # rad, where the centre of mass moves to
    speed: float  # m/s, along the car
    acceleration: float  # m/s², as a sensor along the car feels it
    yaw_rate: float  # rad/s
    angle: float  # rad, of the road wheels

    @property
    def curvature(self) -> float:
        """Yaw rate over speed [1/m]."""
        return self.yaw_rate / self.speed


class Car(Protocol):
    """Anything that can be driven: the multi-body car, or a small one in tests."""

    wheelbase: float
    to_front: float
    """Distance of the centre of mass from the front axle [m]."""

    def start(self, x: float, y: float, heading: float, speed: float) -> Motion:
        """Puts the car on a straight, rolling without steering."""
        ...

    def step(self, asked: float, push: float) -> Motion:
        """Moves on by a sample with a steering angle [rad] and an acceleration [m/s²] asked for."""
        ...


class MultiBody:
    """Vehicle 2 of the package, with an actuator, and what differs in a variation."""

    def __init__(self, variation: Variation, substeps: int = SUBSTEPS) -> None:
        package = _package()
        self._start, self._substeps = package.start, substeps
        self._library, read = package.library, package.translation.attributes
        self._steering, self._asked = Steering(), 0.0
        values = {name: _value(package.parameters, name) for name in read}
        changed = _changed(values, variation, self._steering)
        self._parameters = _with(package.parameters, changed)
        self._p = np.array([_value(self._parameters, name) for name in read])
        self._late = round(variation.delay / SAMPLE_TIME * substeps)
        self.to_front = float(self._parameters.a)
        self.wheelbase = float(self._parameters.a + self._parameters.b)
        self.state, self._slope = np.zeros(29), np.zeros(29)

    def start(self, x: float, y: float, heading: float, speed: float) -> Motion:
        initial = self._start([x, y, 0.0, speed, heading, 0.0, 0.0], self._parameters)
        self.state = np.array(initial, dtype=np.float64)
        self._asked = 0.0
        return self._motion()

    def step(self, asked: float, push: float) -> Motion:
        limit = self._steering.limit
        asked = min(max(asked, -limit), limit)
        self._library.drive(
            _pointer(self.state), ctypes.c_double(self._asked), ctypes.c_double(asked),
            self._late, ctypes.c_double(push), ctypes.c_double(self._steering.lag),
            ctypes.c_double(SAMPLE_TIME), self._substeps, _pointer(self._slope), _pointer(self._p),
        )  # fmt: skip
        self._asked = asked
        motion = self._motion()
        if not motion.speed > LEAST_SPEED:
            raise RuntimeError(f"the car left the model's range at {motion.speed} m/s")
        return motion

    def difference(self, angle_rate: float, push: float) -> float:
        """How far the C is from the package's own Python here, over the size of each slope."""
        u, found = np.array([angle_rate, push]), np.zeros(29)
        self._library.slopes(
            _pointer(self.state.copy()), _pointer(u), _pointer(found), _pointer(self._p)
        )
        asked = self.state.tolist(), u.tolist(), self._parameters
        expected = np.array(_package().dynamics(*asked))
        return float(np.max(np.abs(found - expected) / (1.0 + np.abs(expected))))

    def _motion(self) -> Motion:
        s = self.state
        return Motion(
            x=float(s[0]),
            y=float(s[1]),
            heading=float(s[4]),
            course=float(s[4] + np.arctan2(s[10], s[3])),
            speed=float(s[3]),
            acceleration=float(self._slope[3] - s[5] * s[10]),
            yaw_rate=float(s[5]),
            angle=float(s[2]),
        )


@dataclass(frozen=True)
class _Package:
    """What is taken from CommonRoad's package, and what was made of it."""

    parameters: Any
    start: Callable[[list[float], Any], list[float]]
    dynamics: Callable[[list[float], list[float], Any], list[float]]
    translation: Translation
    library: ctypes.CDLL


_loaded: list[_Package] = []


def _package() -> _Package:
    """The package, translated and compiled on the first call of a process."""
    if not _loaded:
        try:
            from vehiclemodels.init_mb import init_mb
            from vehiclemodels.parameters_vehicle2 import parameters_vehicle2
            from vehiclemodels.vehicle_dynamics_mb import vehicle_dynamics_mb
        except ImportError:
            sys.exit("the car is not installed: pip install commonroad-vehicle-models==3.0.2")
        translation = translate(vehicle_dynamics_mb, frozenset({SLOW}))
        library = _compiled(translation)
        _loaded.append(
            _Package(parameters_vehicle2(), init_mb, vehicle_dynamics_mb, translation, library)
        )
    return _loaded[0]


def _compiled(translation: Translation) -> ctypes.CDLL:
    """The translation with `car.c`, as a library in the folder `build`, named by its text.

    Several processes may come here at once: each compiles in a folder of its own.
    """
    folder = HERE / "build" / "car"
    folder.mkdir(parents=True, exist_ok=True)
    text = translation.text() + "\n" + (HERE / "car.c").read_text(encoding="utf-8")
    library = folder / f"car_{hashlib.sha256(text.encode()).hexdigest()[:16]}.so"
    if not library.exists():
        with TemporaryDirectory(dir=folder) as own:
            source, unfinished = Path(own, "car.c"), Path(own, "car.so")
            source.write_text(text, encoding="utf-8")
            command = ["gcc", "-O2", "-ffp-contract=off", "-shared", "-fPIC", str(source)]
            subprocess.run([*command, "-o", str(unfinished), "-lm"], check=True)
            unfinished.replace(library)
    return ctypes.CDLL(str(library))


def _changed(
    values: Mapping[str, float], variation: Variation, steering: Steering
) -> dict[str, float]:
    """The parameters that differ from the package's; ValueError for one that no equation reads."""
    factors = {**dict.fromkeys(BODY, variation.mass), **dict.fromkeys(GRIP, variation.friction)}
    if unknown := [name for name in (*factors, *RATES) if name not in values]:
        known = ", ".join(sorted(values))
        raise ValueError(f"the car's equations read no {', '.join(unknown)}; they read {known}")
    rates = zip(RATES, (-steering.rate, steering.rate), strict=True)
    return {**{name: factor * values[name] for name, factor in factors.items()}, **dict(rates)}


def _with(parameters: Any, changed: Mapping[str, float]) -> Any:
    """A copy of the package's parameters with other values."""
    copy = deepcopy(parameters)
    for path, value in changed.items():
        *above, name = path.split(".")
        entry = copy
        for part in above:
            entry = getattr(entry, part)
        setattr(entry, name, value)
    return copy


def _value(parameters: Any, path: str) -> float:
    for name in path.split("."):
        parameters = getattr(parameters, name)
    return float(parameters)


def _pointer(values: Array) -> Any:
    return values.ctypes.data_as(ctypes.POINTER(ctypes.c_double))
