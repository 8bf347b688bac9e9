"""Torch as an expert writes it: series gathered once a batch, filters of inputs before the steps.

    python torch_by_hand.py eager|compiled

`compiled` is torch.compile of the whole unrolled rollout; both take torch's fused Adam.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
import torch
from serve import Contender, clock, serve
from torch import Tensor

Weights = dict[str, Tensor]
Loss = Callable[[dict[str, Tensor], int, Weights, Tensor], Tensor]


class TorchByHand(Contender):
    """One workload in torch; the models are written by hand from the formulas of the specs."""

    def __init__(self, mode: str, settings: dict[str, Any]) -> None:
        torch.set_num_threads(1)
        self._settings = settings
        log = np.load(settings["data"])
        self._log = {n: torch.from_numpy(np.asarray(v, np.float32)) for n, v in log.items()}
        self._random = np.random.default_rng(0)
        loss = _vehicle_loss if settings["name"] == "vehicle" else _mass_loss
        self._loss: Loss = torch.compile(loss, dynamic=False) if mode == "compiled" else loss
        self.reset()
        started = time.perf_counter()
        self._update(self._batches(fixed=True)[0])
        self.build_seconds = time.perf_counter() - started
        self.reset()

    def reset(self) -> None:
        shapes: dict[str, tuple[int, ...]] = (
            {"h_v": (30,), "h_brake": (30,), "pedal": (5, 30), "c0": (), "c1": ()}
            if self._settings["name"] == "vehicle"
            else {"h_x": (20,), "h_F": (20,)}
        )
        self._weights = {n: torch.zeros(s, requires_grad=True) for n, s in shapes.items()}
        self._adam = torch.optim.Adam(self._weights.values(), lr=self._settings["lr"], fused=True)

    def epochs(self, count: int, fixed: bool) -> tuple[float, list[float]]:
        losses: list[float] = []
        started = clock()
        for _ in range(count):
            batches = self._batches(fixed)
            losses.append(sum(self._update(batch) for batch in batches) / len(batches))
        return clock() - started, losses

    def _batches(self, fixed: bool) -> Tensor:
        size, starts = self._settings["batch"], self._settings["starts"]
        order = np.arange(starts) if fixed else self._random.permutation(starts)
        rows = order[: starts - starts % size] + self._settings["first"]
        return torch.from_numpy(rows.reshape(-1, size))

    def _update(self, starts: Tensor) -> float:
        self._adam.zero_grad()
        loss = self._loss(self._log, self._settings["horizon"], self._weights, starts)
        loss.backward()
        self._adam.step()
        return loss.item()


def _windows(series: Tensor, starts: Tensor, first: int, count: int) -> Tensor:
    """The samples from `first` after each start row: (batch, count)."""
    return series[starts[:, None] + torch.arange(first, first + count)]


def _mass_loss(log: dict[str, Tensor], horizon: int, weights: Weights, starts: Tensor) -> Tensor:
    force = _windows(log["F"], starts, -19, horizon + 19)
    driven = force.unfold(1, 20, 1) @ weights["h_F"]
    samples = list(_windows(log["x"], starts, -19, 20).unbind(1))
    for t in range(horizon):
        past = torch.stack(samples[-20:], 1)
        samples.append(samples[-1] + past @ weights["h_x"] + driven[:, t])
    error = torch.stack(samples[20:], 1) - _windows(log["x"], starts, 1, horizon)
    return (error * error).mean()


def _vehicle_loss(log: dict[str, Tensor], horizon: int, weights: Weights, starts: Tensor) -> Tensor:
    pedal = _windows(log["u"], starts, -29, horizon + 29).unfold(1, 30, 1)
    brake = _windows(log["brake"], starts, -29, horizon + 29).unfold(1, 30, 1)
    local, braked = pedal @ weights["pedal"].T, brake @ weights["h_brake"]
    centers = torch.arange(5.0)
    samples = list(_windows(log["v"], starts, -29, 30).unbind(1))
    for t in range(horizon):
        now = samples[-1]
        place = (now / 10.0).clamp(0.0, 4.0)
        sets = (1.0 - (place[:, None] - centers).abs()).clamp(min=0.0)
        new = now + torch.stack(samples[-30:], 1) @ weights["h_v"] + (sets * local[:, t]).sum(1)
        samples.append(new + braked[:, t] + weights["c0"] + weights["c1"] * now * now)
    error = torch.stack(samples[30:], 1) - _windows(log["v"], starts, 1, horizon)
    return (error * error).mean()


if __name__ == "__main__":
    serve(lambda text: TorchByHand(sys.argv[1], json.loads(text)))
