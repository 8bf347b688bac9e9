"""Identifies a system with torch by hand: a loop over the rows, L-BFGS, float64."""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

import numpy as np
import torch

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from systems import SYSTEMS, beginning, first_values, processor_seconds, step

torch.set_num_threads(1)
system = SYSTEMS[sys.argv[1]]
data = {name: torch.from_numpy(values) for name, values in np.load(sys.argv[2]).items()}
first = torch.from_numpy(first_values(system))


class Functions:
    """The functions of numpy that right-hand sides use, in torch."""

    sqrt, abs, sin, tanh = torch.sqrt, torch.abs, torch.sin, torch.tanh

    @staticmethod
    def maximum(value, limit):
        return torch.clamp(torch.as_tensor(value, dtype=torch.float64), min=limit)


def simulated(raw, name):
    values = list(raw * first)
    x, found = list(data[f"{name}_x0"]), []
    for u in data[f"{name}_u"]:
        found.append(x[system.output])
        x = step(system, Functions, x, u, values, system.sample_time)
    return torch.stack(found)


def loss(raw):
    return torch.mean((simulated(raw, "train") - data["train_y"]) ** 2)


def fitted():
    raw = torch.ones(len(first), dtype=torch.float64, requires_grad=True)
    optimizer = torch.optim.LBFGS(
        [raw], max_iter=100, line_search_fn="strong_wolfe", tolerance_change=1e-12
    )

    def closure():
        optimizer.zero_grad()
        value = loss(raw)
        value.backward()
        return value

    optimizer.step(closure)
    return raw.detach()


began, before = beginning(0)
raw = fitted()
seconds = [time.perf_counter() - began]
computed = [processor_seconds() - before]
clean = simulated(raw, "test") - data["test_clean"]
print(
    json.dumps(
        {
            "seconds": seconds,
            "computed": computed,
            "loss": float(loss(raw)),
            "test": float(clean.std()),
            "parameters": (raw * first).tolist(),
        }
    )
)
