"""Trains a workload by nnodely, in a Python environment of its own, with its own loop and clock."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
import torch
from nnodely import (
    Fir,
    Fuzzify,
    Input,
    LocalModel,
    Modely,
    Output,
    Parameter,
    ParamFun,
    TimeConcatenate,
    clearNames,
)
from nnodely.operators import trainer
from nnodely.visualizer import EmptyVisualizer
from serve import PROCESSOR_TIME, Contender, clock, serve

ZERO = {"W_init": "init_constant", "W_init_params": {"value": 0.0}}


if PROCESSOR_TIME:  # its own clock around the epochs, read from another dial
    trainer.time = SimpleNamespace(time=clock)


class Clock(EmptyVisualizer):
    """Receives what nnodely's training loop reports at its end, such as its time."""

    seconds = 0.0

    def showTrainingTime(self, time: float) -> None:  # noqa: N802  (its name there)
        self.seconds = time


def quadratic(v, c0, c1):
    return c0 + c1 * v * v


class Nnodely(Contender):
    """One workload; `settings` are those of the workload's file."""

    def __init__(self, settings: dict[str, Any]) -> None:
        torch.set_num_threads(1)
        self._settings = settings
        self._arrays = dict(np.load(settings["data"]))
        self._build()

    def _build(self) -> None:
        clearNames()
        self._clock = Clock()
        model = Modely(visualizer=self._clock, seed=1)
        built = MODELS[self._settings["name"]]()
        model.addModel("model", Output("prediction", built.fed_back))
        model.addMinimize("error", Output("scored", built.scored), built.target.next(), "mse")
        model.neuralizeModel(self._settings["sample_time"])
        model.loadData("log", built.log(self._arrays))
        self._model, self._built = model, built

    def reset(self) -> None:
        self._build()

    def epochs(self, count: int, fixed: bool) -> tuple[float, list[float]]:
        steps = self._settings["horizon"]
        rollout: dict[str, Any] = (
            {"closed_loop": {self._built.closed: "prediction"}, "prediction_samples": steps - 1}
            if steps > 1
            else {"prediction_samples": -1}
        )
        self._model.trainModel(
            splits=[100, 0, 0],
            shuffle_data=not fixed,
            num_of_epochs=count,
            train_batch_size=self._settings["batch"],
            optimizer="Adam",
            lr=self._settings["lr"],
            lr_param=dict.fromkeys(self._built.frozen, 0.0),
            **rollout,
        )
        return self._clock.seconds, [float(x) for x in self._model._training["error"]["train"]]


@dataclass(frozen=True)
class Built:
    """A model in nnodely: which outputs are fed back to which inputs, and which ones are
    compared.
    """

    fed_back: Any
    closed: str
    scored: Any
    target: Any
    log: Callable[[dict[str, Any]], dict[str, Any]]
    frozen: tuple[str, ...] = ()


def _mass() -> Built:
    x, force, target = Input("x"), Input("F"), Input("target")
    stream = x.last() + Fir(**ZERO)(x.sw(20)) + Fir(**ZERO)(force.sw(20))
    return Built(stream, "x", stream, target, lambda log: {**log, "target": log["x"]})


def _vehicle() -> Built:
    v, pedal, brake, target = Input("v"), Input("u"), Input("brake"), Input("target")
    sets = Fuzzify(centers=[0.0, 10.0, 20.0, 30.0, 40.0], functions="Triangular")(v.last())
    local = LocalModel(input_function=lambda: Fir(**ZERO))(pedal.sw(30), sets)
    resistance = ParamFun(
        quadratic, [Parameter("c0", values=[0.0]), Parameter("c1", values=[0.0])]
    )(v.last())
    stream = v.last() + Fir(**ZERO)(v.sw(30)) + local + Fir(**ZERO)(brake.sw(30)) + resistance
    return Built(stream, "v", stream, target, lambda log: {**log, "target": log["v"]})


def _steering() -> Built:
    """`past` is one sample later than the angle: what is fed back arrives at the next step."""
    v, a, rho, past = Input("v"), Input("a"), Input("rho"), Input("past")
    phi_v = Fuzzify(centers=CENTERS, functions="Triangular")(v.last())
    phi_a = Fuzzify(centers=[-2.0, -1.0, 0.0, 1.0, 2.0], functions="Triangular")(a.last())
    understeer = Parameter("A", values=np.linspace(5e-4, 15e-4, 5).tolist())
    under = ParamFun(weighted, [understeer])(phi_a)
    nabla = ParamFun(understeered)(rho.sw([-1, 29]), v.sw([-1, 29]), under)
    ahead = LocalModel(input_function=_cell("W", lambda _: np.full(30, 0.01)), pass_indexes=True)(
        nabla, phi_v
    )
    steer = ahead + Fir(W=Parameter("w0", sw=29, values=[[0.0]] * 29))(past.sw(29))
    angles = TimeConcatenate(past.sw(29), steer)
    turned = LocalModel(input_function=_cell("V", _turning), pass_indexes=True)(angles, phi_v)
    curvature = ParamFun(divided)(turned, v.last(), under)
    frozen = ("A", *(f"V{i}" for i in range(len(CENTERS))))
    return Built(steer, "past", curvature, rho, _shifted, frozen)


CENTERS = [8.0 + 16.0 / 7.0 * i for i in range(8)]


def _cell(name, taps):
    """One filter over 30 samples for each fuzzy set, each with its own parameter."""

    def made(index):
        values = taps(index[0]).reshape(30, 1).tolist()
        return Fir(W=Parameter(f"{name}{index[0]}", sw=30, values=values))

    return made


def _turning(index):
    """The fixed coefficients of the vehicle's filter for one fuzzy set."""
    return (1 + 0.05 * index) * 0.1 * np.exp(np.arange(-29, 1) / 4)


def _shifted(log):
    return {"past": log["delta"][:-1], **{name: log[name][1:] for name in ("v", "a", "rho")}}


def weighted(phi, A):
    return (phi * A).sum(dim=2, keepdim=True)


def understeered(rho, v, under):
    return rho * (1 + under * v**2)


def divided(turned, v, under):
    return turned / (1 + under * v**2)


MODELS = {
    "feed_forward": _mass,
    "closed_loop": _mass,
    "vehicle": _vehicle,
    "steering": _steering,
}


if __name__ == "__main__":
    serve(lambda text: Nnodely(json.loads(text)))
