"""Compares curvatures on the recorded test drive with what the car did without noise."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from closed_loop import Controller, Seen
from preview import LOOK, Place, Preview
from setting import SAMPLE_TIME

import msnn

Array = npt.NDArray[np.float64]
Drive = Mapping[str, Array]

PAST = 30  # samples that the vehicle's filter looks back


@dataclass(frozen=True)
class Trace:
    """Predicted curvatures of a stretch of the drive, and the true ones [1/m]."""

    time: Array  # s
    predicted: Array
    true: Array

    @property
    def mse(self) -> float:
        """Mean square of the error [1/m²]."""
        return float(np.mean((self.predicted - self.true) ** 2))

    @property
    def worst(self) -> float:
        """Largest error [1/m]."""
        return float(np.max(np.abs(self.predicted - self.true)))


def read(path: Path) -> Drive:
    """A recorded drive, a column of its file under each name."""
    with path.open(encoding="utf-8") as stream:
        names = stream.readline().strip().split(",")
    return dict(zip(names, np.loadtxt(path, delimiter=",", skiprows=1).T, strict=True))


def through_vehicle(spec: Path, drive: Drive, asked: Array) -> Trace:
    """The learned vehicle, steered by `asked` from the first sample to the last."""
    vehicle = msnn.stepper(msnn.load(str(spec)), str(spec.parent / "runs" / "vehicle" / "latest"))
    vehicle.reset(a=drive["a"][0], delta=0.0)
    steps = zip(drive["v"], drive["a"], asked, strict=False)
    found = [float(vehicle.step(v=v, a=a, delta=angle)["rho_hat"]) for v, a, angle in steps]
    return _scored(np.array(found), drive["rho_true"][1:])


def through_kinematics(drive: Drive, wheelbase: float) -> Trace:
    """tan(measured angle of the road wheels) / wheelbase, of the same sample."""
    return _scored(np.tan(drive["angle"]) / wheelbase, drive["rho_true"])


def steered(controller: Controller, drive: Drive) -> Array:
    """What a controller asks for that sees the recorded drive as its planned path."""
    asked: list[float] = []
    for t in range(len(drive["v"]) - LOOK):
        path = Preview(drive["rho"][t : t + LOOK], drive["v"][t : t + LOOK])
        place = Place(0.0, 0.0, 0.0, float(drive["rho"][t]))
        yaw_rate = float(drive["rho"][t] * drive["v"][t])
        seen = Seen(float(drive["v"][t]), float(drive["a"][t]), yaw_rate, place, 0.0, path)
        if not asked:
            controller.start(seen)
        asked.append(controller.steer(seen))
    return np.array(asked)


def _scored(predicted: Array, true: Array) -> Trace:
    """The rows that everything compared here has."""
    rows = slice(PAST, len(true) - LOOK)
    time = SAMPLE_TIME * np.arange(len(true))
    return Trace(time[rows], predicted[rows], true[rows])
