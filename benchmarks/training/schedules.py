"""Measures which schedule of the learning rate ends best, over the gallery with the same updates.

    python benchmarks/training/schedules.py [--noise SHARE …] [--write]

Every model of the gallery trains its own stage natively for 300 epochs, with adam at three rates,
from three draws of initial weights with three orders of batches; on its records as they are
simulated, without noise, and with noise of 2 % on what it predicts. A schedule is judged by the
validation loss of the best epoch, as training judges it, as a multiple of the best that any
schedule reaches from the same start with the same rate: the geometric mean, and the ninth decile.
`--write` puts the table into SCHEDULES.md.
"""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
from collections.abc import Sequence
from itertools import product
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from compiler.elaboration.compile import compile_spec
from msnn.api import trainings
from msnn.model.load import load_model
from msnn.model.weights.weights_file import initial_weights
from msnn.training.training_result import TrainingDivergedError
from tests.examples.gallery import NAMES, gallery_copy, spec_of

HERE = Path(__file__).resolve().parent
EPOCHS = (300,)
RATES = (1e-3, 1e-2, 1e-1)
SEEDS = (0, 1, 2)
NOISES = (0.0, 0.02)
Found = dict[tuple[float, int, float, str, int], dict[str, float]]

LEFT = 0.01
"""What an exponential schedule leaves of the rate."""


def schedules(epochs: int) -> dict[str, str]:
    """The compared schedules of the learning rate, by name, as texts of a spec."""
    return {
        "constant": "null",
        "cosine": "{cosine: {}}",
        "cosine to 0.1": "{cosine: {to: 0.1}}",
        "exponential to 0.01": f"{{exponential: {{factor: {LEFT ** (1 / epochs):.6f}}}}}",
        "plateau": "{plateau: {patience: 10, factor: 0.3, min: 0.001}}",
    }


def trained(spec: Path, epochs: int, rate: float, schedule: str, seed: int) -> float:
    """The validation loss of the best epoch; infinite where training diverges."""
    settings = [
        f"train.0.epochs={epochs}",
        f"train.0.optimizer={{adam: {{lr: {rate}}}}}",
        f"train.0.seed={seed}",
        "train.0.engine=native",
    ]
    if schedule != "null":
        settings.append(f"train.0.schedule={schedule}")
    model = load_model(spec, settings)
    drawn = compile_spec(model.spec, used=model.read.used, draw=seed).program
    try:
        result = trainings.train(model, weights=initial_weights(drawn), runs=None)
    except TrainingDivergedError:
        return math.inf
    return result.stages[-1].best_value


def with_noise(folder: Path, share: float) -> None:
    """Adds noise to the columns that a model predicts: `share` of their standard deviation."""
    random = np.random.default_rng(216)
    for name in NAMES:
        spec = load_model(spec_of(folder, name)).spec
        predicted = {
            o.predicts.signal.value for o in spec.outputs.values() if o.predicts is not None
        }
        file = folder / "data" / f"{name}.csv"
        head, *rows = file.read_text(encoding="utf-8").splitlines()
        columns = head.split(",")
        values = np.array([row.split(",") for row in rows], float)
        for at, column in enumerate(columns):
            if column.rstrip("0123456789") in predicted or column in predicted:
                size = share * values[:, at].std()
                values[:, at] += random.normal(0, 1, len(values)) * size
        lines = [head, *(",".join(repr(float(v)) for v in row) for row in values)]
        file.write_text("\n".join(lines) + "\n", encoding="utf-8")


def main() -> None:
    """Measures and shows, or writes, the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--noise", type=float, nargs="*", default=NOISES)
    given = parser.parse_args()
    found: Found = {}
    for noise in given.noise:
        with tempfile.TemporaryDirectory() as place:
            folder = gallery_copy(Path(place))
            if noise:
                with_noise(folder, noise)
            for name, epochs, rate, seed in product(NAMES, EPOCHS, RATES, SEEDS):
                found[noise, epochs, rate, name, seed] = {
                    label: trained(spec_of(folder, name), epochs, rate, text, seed)
                    for label, text in schedules(epochs).items()
                }
                print(noise, name, epochs, rate, seed, file=sys.stderr, flush=True)
    tables = [by_rate(found), at_best_rate(found), by_model(found)]
    text = "\n\n".join(tables)
    print(text)
    if given.write:
        head = (HERE / "SCHEDULES.md").read_text(encoding="utf-8").partition("<!-- measured -->")[0]
        whole = f"{head}<!-- measured -->\n\n{text}\n"
        (HERE / "SCHEDULES.md").write_text(whole, encoding="utf-8")


def by_rate(found: Found) -> str:
    """A table with one row for each noise, number of epochs and learning rate."""
    rows: list[Sequence[str]] = []
    labels = list(schedules(1))
    noises = list(dict.fromkeys(key[0] for key in found))
    for noise, epochs, rate in product(noises, EPOCHS, RATES):
        of = [v for k, v in found.items() if k[:3] == (noise, epochs, rate)]
        told = [f"{noise:.0%}", str(epochs), f"{rate:g}"]
        rows.append([*told, *(_said(of, label) for label in labels)])
    for noise in noises:
        of = [v for k, v in found.items() if k[0] == noise]
        rows.append([f"{noise:.0%}", "all", "all", *(_said(of, label) for label in labels)])
    every = list(found.values())
    rows.append(["all", "all", "all", *(_said(every, label) for label in labels)])
    return _markdown(["noise", "epochs", "rate", *labels], rows)


def at_best_rate(found: Found) -> str:
    """A table with one row per noise: every schedule at its best learning rate for each model."""
    labels = list(schedules(1))
    rows: list[Sequence[str]] = []
    for noise in dict.fromkeys(key[0] for key in found):
        of: list[dict[str, float]] = []
        for name, seed in product(NAMES, SEEDS):
            runs = [v for k, v in found.items() if (k[0], *k[3:]) == (noise, name, seed)]
            of.append({label: min(one[label] for one in runs) for label in labels})
        rows.append([f"{noise:.0%}", *(_said(of, label) for label in labels)])
    return _markdown(["noise, each at its best rate", *labels], rows)


def by_model(found: Found) -> str:
    """A table with one row per model."""
    labels = list(schedules(1))
    rows: list[Sequence[str]] = []
    for name in NAMES:
        of = [v for k, v in found.items() if k[3] == name]
        rows.append([name, *(_said(of, label) for label in labels)])
    return _markdown(["model", *labels], rows)


def _said(of: Sequence[dict[str, float]], label: str) -> str:
    ratios = [values[label] / max(min(values.values()), 1e-300) for values in of]
    ratios = [min(ratio, 1e6) if ratio == ratio else 1.0 for ratio in ratios]
    mean = float(np.exp(np.mean(np.log(ratios))))
    return f"{mean:.3f} ({float(np.quantile(ratios, 0.9)):.2f})"


def _markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = ["| " + " | ".join(row) + " |" for row in (head, ["---"] * len(head), *rows)]
    return "\n".join(lines)


if __name__ == "__main__":
    main()
