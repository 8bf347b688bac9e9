"""The peer: nnodely in an environment of its own, its own training loop, timed by its own clock."""

from __future__ import annotations

import json
import sys
from pathlib import Path
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
    clearNames,
)
from nnodely.visualizer import EmptyVisualizer
from serve import Contender, serve

ZERO = {"W_init": "init_constant", "W_init_params": {"value": 0.0}}


class Clock(EmptyVisualizer):
    """Keeps what the training loop tells at its end."""

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
        stream, closed, target = (_vehicle if self._settings["name"] == "vehicle" else _mass)()
        model.addModel("model", Output("prediction", stream))
        model.addMinimize("error", Output("scored", stream), target.next(), "mse")
        model.neuralizeModel(self._settings["sample_time"])
        model.loadData("log", {**self._arrays, "target": self._arrays[closed]})
        self._model, self._closed = model, closed

    def reset(self) -> None:
        self._build()

    def epochs(self, count: int, fixed: bool) -> tuple[float, list[float]]:
        steps = self._settings["horizon"]
        rollout: dict[str, Any] = (
            {"closed_loop": {self._closed: "prediction"}, "prediction_samples": steps - 1}
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
            **rollout,
        )
        return self._clock.seconds, [float(x) for x in self._model._training["error"]["train"]]


def _mass():
    x, force, target = Input("x"), Input("F"), Input("target")
    return x.last() + Fir(**ZERO)(x.sw(20)) + Fir(**ZERO)(force.sw(20)), "x", target


def _vehicle():
    v, pedal, brake, target = Input("v"), Input("u"), Input("brake"), Input("target")
    sets = Fuzzify(centers=[0.0, 10.0, 20.0, 30.0, 40.0], functions="Triangular")(v.last())
    local = LocalModel(input_function=lambda: Fir(**ZERO))(pedal.sw(30), sets)
    resistance = ParamFun(
        quadratic, [Parameter("c0", values=[0.0]), Parameter("c1", values=[0.0])]
    )(v.last())
    stream = v.last() + Fir(**ZERO)(v.sw(30)) + local + Fir(**ZERO)(brake.sw(30)) + resistance
    return stream, "v", target


if __name__ == "__main__":
    serve(lambda text: Nnodely(json.loads(text)))
