"""Saves models of nnodely and their predictions; runs in the environment of nnodely."""

from __future__ import annotations

import json
import logging
import random
import sys
import tempfile
import time
from pathlib import Path

import function_models  # noqa: F401  (adds its models)
import large_models  # noqa: F401
import numpy as np
import random_models  # noqa: F401
import torch
from layer_models import MODELS
from nnodely import Modely, clearNames

SAMPLE_TIME = 0.1
ROWS = 12
STARTS_AT_ZERO = {"closed_window", "closed_ahead"}
"""Models whose loops the spec does not begin in the log."""


def record(name: str, folder: Path) -> str | None:
    """Builds, saves and runs one model; returns the reason as a text if nnodely itself fails."""
    clearNames()
    torch.manual_seed(sum(map(ord, name)))
    random.seed(name)
    m = Modely(visualizer=None, seed=sum(map(ord, name)) % 1000)
    MODELS[name](m)
    m.neuralizeModel(SAMPLE_TIME)
    for parameter in m._model.all_parameters.values():
        # weights of both signs, as training leaves them
        with torch.no_grad():
            parameter.sub_(0.5).mul_(0.8)
    m._model_def.updateParameters(m._model)
    kept = predicted(m, name)
    if isinstance(kept, str):
        return kept
    (folder / f"{name}.json").write_text(json.dumps(kept))
    return None


def predicted(m: Modely, name: str, *, begins_loops: bool = True) -> dict[str, object] | str:
    """The saved model with random data and nnodely's predictions, or the reason why there are none.

    Loops begin with random values, or at 0.
    """
    with tempfile.TemporaryDirectory() as place:
        m.saveModel(name, place)
        text = (Path(place) / f"{name}.json").read_text()
    definition = json.loads(text)
    inputs = definition["Inputs"]
    draw = np.random.default_rng(sum(map(ord, name)))
    back = max(1, *(one["ns"][0] for one in inputs.values()))
    ahead = max(one["ns"][1] for one in inputs.values())
    rows = ROWS + back + max(ahead, 0)
    log = {}
    given = {}
    for key, one in inputs.items():
        shape = (rows,) if one["dim"] == 1 else (rows, one["dim"])
        values = np.float32(np.round(draw.normal(0, 0.8, shape), 3))
        first = back - one["ns"][0]
        samples = ROWS - 1 + one["ntot"]
        if "connect" in one:
            continue
        if "closedLoop" in one and (name in STARTS_AT_ZERO or not begins_loops):
            continue
        if "closedLoop" in one:
            if one["local"] and key.rsplit("_", 1)[-1][:2] in {"sw", "tw", "in", "de"}:
                continue
            samples = one["ntot"]
        log[key] = values.tolist()
        given[key] = values[first : first + samples].tolist()
    m.resetStates()
    found = m(given) if given else m(num_of_samples=ROWS)
    m.resetStates()
    outputs = {key: np.asarray(value, np.float64).tolist() for key, value in found.items()}
    for key, value in outputs.items():
        if not np.all(np.isfinite(value)):
            return f"{key} is not finite"
    return {"model": text, "first": back - 1, "log": log, "outputs": outputs}


def main() -> None:
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    chosen = sys.argv[2:] or list(MODELS)
    for name in chosen:
        began = time.monotonic()
        try:
            why = record(name, folder)
        except Exception as fault:  # noqa: BLE001  (nnodely fails in many ways)
            why = f"{type(fault).__name__}: {fault}"
        if why is not None:
            print(f"{name}: nnodely fails: {why} ({time.monotonic() - began:.1f} s)")


if __name__ == "__main__":
    logging.disable(logging.CRITICAL)
    main()
