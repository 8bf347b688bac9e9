"""Trains on 15, 25, 50 and 100 % of the training data: friction, least squares, LSTM, perceptron.

A part of the data are the first episodes and the beginning of the next one; validation and test
episodes are the same for all. The friction on all data is what `msnn train` left in `runs`. The
errors of rollouts of 0.5 s over the test episodes are kept in `runs/series.json`.

    python series.py
"""

from __future__ import annotations

import subprocess
import sys
from concurrent.futures import ProcessPoolExecutor
from itertools import product
from pathlib import Path

import numpy as np
import results
from evaluate import (
    HERE,
    Array,
    Bodies,
    Episode,
    determination,
    episodes,
    errors,
    learned,
    regression,
    simulated,
    windows,
)
from generate_data import SAMPLES
from networks import KINDS, Network

WEIGHTS = Path("z1_friction", "latest", "weights.safetensors")


def split_of(percent: int) -> str:
    """The folder below `data` with a part of the training episodes, written if it is not all."""
    if percent == 100:
        return "train"
    files = sorted((HERE / "data" / "train").glob("*.csv"))
    name = f"train_{percent}"
    folder = HERE / "data" / name
    folder.mkdir(exist_ok=True)
    left = round(len(files) * SAMPLES * percent / 100)
    for file in files:
        lines = file.read_text(encoding="utf-8").splitlines(keepends=True)
        if left > 0:
            (folder / file.name).write_text("".join(lines[: left + 1]), encoding="utf-8")
        left -= SAMPLES
    return name


def trained(percent: int) -> Path:
    """The weights of the friction that `msnn train` learns from a part."""
    split = split_of(percent)
    if split == "train":
        return HERE / "runs" / WEIGHTS
    out = Path("runs", split)
    command = ["train", "z1_friction.msnn.yaml", "--set", f"data.source.train=data/{split}"]
    whole = [sys.executable, "-m", "msnn", *command, "--out", str(out), "--quiet"]
    subprocess.run(whole, cwd=HERE, check=True, stdout=subprocess.DEVNULL)
    return HERE / out / WEIGHTS


def by_network(kind: str, percent: int) -> Array:
    """The positions of the test rollouts, by a network that learned from a part."""
    network = Network(kind, episodes(split_of(percent)), episodes("val"))
    return network.simulated(windows(episodes("test")))


def by_friction(percent: int) -> dict[str, Array]:
    """The positions by learned friction and by least squares."""
    bodies, test = Bodies(), windows(episodes("test"))
    part: list[Episode] = episodes(split_of(percent))
    return {
        "learned": simulated(bodies, learned(trained(percent)), test),
        "full least squares": simulated(bodies, regression(bodies, part, full=True), test),
        "least squares": simulated(bodies, regression(bodies, part, full=False), test),
    }


def main() -> None:
    test = windows(episodes("test"))
    for percent in results.PERCENTS:
        split_of(percent)
    with ProcessPoolExecutor(4) as pool:
        frictions = {p: pool.submit(by_friction, p) for p in results.PERCENTS}
        networks = {
            (kind, p): pool.submit(by_network, kind, p)
            for kind, p in product(KINDS, results.PERCENTS)
        }
    kept: dict[str, dict[str, dict[str, float]]] = {}
    for percent, friction in frictions.items():
        found = friction.result() | {kind: networks[kind, percent].result() for kind in KINDS}
        kept[str(percent)] = {
            name: {"mse": float(np.mean(errors(q, test))), "r2": determination(q, test)}
            for name, q in found.items()
        }
        said = (f"{name} {one['mse']:.2e} rad²" for name, one in kept[str(percent)].items())
        print(f"{percent:3} % of the data: {', '.join(said)}", flush=True)
    results.keep("series", kept)


if __name__ == "__main__":
    main()
