"""Trains a workload by NeuroMANCER, in a Python environment of its own, with its own trainer."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
import torch
from neuromancer.constraint import variable
from neuromancer.dataset import DictDataset
from neuromancer.loss import PenaltyLoss
from neuromancer.problem import Problem
from neuromancer.system import Node, System
from neuromancer.trainer import Trainer
from serve import Contender, clock, serve
from torch.utils.data import DataLoader


class Filters(torch.nn.Module):
    """The model of the mass: two filters over the last 20 samples, without bias, with initial
    weights 0.
    """

    def __init__(self) -> None:
        super().__init__()
        self.x, self.force = (torch.nn.Linear(20, 1, bias=False) for _ in range(2))
        for layer in (self.x, self.force):
            torch.nn.init.zeros_(layer.weight)

    def forward(self, past, force):
        new = past[:, -1:] + self.x(past) + self.force(force)
        return torch.cat([past[:, 1:], new], dim=1)


class Neuromancer(Contender):
    """Workload a or b, the mass; `settings` are those of the workload's file."""

    def __init__(self, settings: dict[str, Any]) -> None:
        if settings["name"] not in {"feed_forward", "closed_loop"}:
            message = f"no program for {settings['name']}"
            raise ValueError(message)
        torch.set_num_threads(1)
        self._settings = settings
        log = {k: np.asarray(v, np.float32) for k, v in np.load(settings["data"]).items()}
        steps, size = settings["horizon"], settings["batch"]
        starts = settings["first"] + np.arange(settings["starts"] - settings["starts"] % size)
        windows = np.lib.stride_tricks.sliding_window_view
        past, driven = windows(log["x"], 20), windows(log["F"], 20)
        ahead = starts[:, None] + np.arange(steps)
        series = {
            "past": past[starts - 19][:, None],  # (starts, 1, 20)
            "force": driven[ahead - 19],  # (starts, steps, 20)
            "target": log["x"][ahead + 1][..., None],
        }
        self._data = DictDataset({k: torch.tensor(v) for k, v in series.items()}, name="train")
        self.reset()

    def reset(self) -> None:
        system = System(
            [Node(Filters(), ["past", "force"], ["past"], name="mass")],
            nsteps=self._settings["horizon"],
        )
        error = variable("past")[:, 1:, -1:] == variable("target")
        self._problem = Problem([system], PenaltyLoss([(1.0 * error) ^ 2], []))
        self._adam = torch.optim.Adam(self._problem.parameters(), lr=self._settings["lr"])

    def epochs(self, count: int, fixed: bool) -> tuple[float, list[float]]:
        losses: list[float] = []
        loader = DataLoader(
            self._data,
            batch_size=self._settings["batch"],
            collate_fn=self._data.collate_fn,
            shuffle=not fixed,
        )
        trainer = Trainer(
            self._problem,
            loader,
            optimizer=self._adam,
            epochs=count,
            patience=count,
            eval_metric="train_loss",
            clip=float("inf"),
        )
        trainer.callback.begin_epoch = lambda _, output: losses.append(
            output["mean_train_loss"].item()
        )
        started = clock()
        trainer.train()
        return clock() - started, losses


if __name__ == "__main__":
    serve(lambda text: Neuromancer(json.loads(text)))
