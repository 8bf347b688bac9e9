"""Measures how soon each optimiser reaches a validation loss, on two systems with physical models.

    python benchmarks/second_order/run.py [--data FOLDER] [--write]

Every optimiser trains the same spec from the same initial values, natively, in one process after
the kernels are built. The target is 1.01 times the best validation loss that any of them reaches;
`--write` puts the table into RESULTS.md.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import dataclass, field, replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from msnn.api import trainings
from msnn.model.load import load_model
from msnn.model.model import Model
from msnn.training.records.progress import EpochEnd, Silent

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
DATA = ROOT.parent / "shared" / "data" / "quarter_drone" / "sinal4_multiseno_malha_fechada.csv"
OPTIMIZERS = {
    "levenberg_marquardt": "{epochs: 60, optimizer: levenberg_marquardt}",
    "lbfgs": "{epochs: 15, dtype: float64, optimizer: {lbfgs: {iterations: 20}}}",
    "adam, lr 0.01": "{epochs: 2000, dtype: float64, optimizer: {adam: {lr: 0.01}}}",
    "adam, lr 0.1": "{epochs: 2000, dtype: float64, optimizer: {adam: {lr: 0.1}}}",
}
CLOSE = (2.0, 1.1, 1.01)
"""Times the best validation loss."""


@dataclass
class Watched(Silent):
    """A receiver of progress that notes when each epoch ended, and the best validation loss
    so far.
    """

    seconds: list[float] = field(default_factory=list[float])
    best: list[float] = field(default_factory=list[float])

    def epoch_ended(self, event: EpochEnd) -> None:
        """Notes the time and the best validation loss after an epoch."""
        self.seconds.append(event.seconds)
        self.best.append(event.best)


def systems(drone: Path) -> dict[str, tuple[Path, tuple[str, ...], Path]]:
    """The spec, settings and data folder of each system whose data are available."""
    plant = ROOT / "examples" / "mass_spring_damper" / "msd_physical.msnn.yaml"
    found = {"mass-spring-damper": (plant, ("rollout: episode",), plant.parent)}
    if drone.is_file():
        spec = ROOT / "benchmarks" / "quarter_drone" / "drone_arm.msnn.yaml"
        found["drone arm"] = (spec, ("rollout: record",), drone.parent)
    return found


def with_stage(spec: Path, stage: str, source: Path | None) -> Model:
    """The model with a single training stage; `source` replaces the file of its data."""
    settings = [f"train=[{stage}]"]
    if source is not None:
        settings.append(f"data.source.all={source.name}")
        settings.append("data.split={by: block, blocks: 5, train: [1, 3], val: [5], test: [2, 4]}")
    model = load_model(spec, settings)
    return replace(model)


def measured(spec: Path, rollout: str, folder: Path, source: Path | None) -> dict[str, Watched]:
    """Trains by every optimiser; each kernel is built before its clock starts."""
    runs: dict[str, Watched] = {}
    for name, options in OPTIMIZERS.items():
        stage = options.replace("{", f"{{{rollout}, ", 1)
        model = with_stage(spec, stage, source)
        warm = with_stage(spec, stage.replace("epochs: ", "epochs: 1, x-epochs: "), source)
        trainings.train(warm, data_root=folder, runs=None)
        runs[name] = Watched()
        began = time.perf_counter()
        trainings.train(model, data_root=folder, runs=None, progress=runs[name])
        print(f"  {name}: {time.perf_counter() - began:.2f} s", file=sys.stderr)
    return runs


def table(title: str, runs: dict[str, Watched]) -> str:
    """A table of epochs and seconds until the validation loss is within given factors of
    the best.
    """
    best = min(run.best[-1] for run in runs.values())
    heads = " | ".join(f"to {close:g}× best" for close in CLOSE)
    lines = [f"## {title}", "", f"Best validation loss {best:.4g}.", ""]
    lines += [f"| optimizer | {heads} | ends at | in |", "|---|" + "---|" * (len(CLOSE) + 2)]
    for name, run in runs.items():
        cells: list[str] = []
        for close in CLOSE:
            reached = [i for i, value in enumerate(run.best) if value <= close * best]
            place = reached[0] if reached else None
            cells.append("no" if place is None else f"{place + 1} ep, {run.seconds[place]:.3f} s")
        end = f"{run.best[-1] / best:.4g}×"
        lines.append(f"| {name} | {' | '.join(cells)} | {end} | {run.seconds[-1]:.2f} s |")
    return "\n".join([*lines, ""])


def main() -> None:
    """Measure every system that has its data, and print or write the tables."""
    parser = argparse.ArgumentParser(description="Compare optimisers on physical models.")
    parser.add_argument("--data", type=Path, default=DATA, help="a record of the drone arm")
    parser.add_argument("--write", action="store_true", help="write RESULTS.md")
    arguments = parser.parse_args()
    parts: list[str] = []
    for title, (spec, (rollout,), folder) in systems(arguments.data).items():
        source = arguments.data if folder == arguments.data.parent else None
        parts.append(table(title, measured(spec, rollout, folder, source)))
    text = "\n".join(parts)
    print(text)
    if arguments.write:
        before = (HERE / "RESULTS.md").read_text(encoding="utf-8").partition("## ")[0]
        (HERE / "RESULTS.md").write_text(before + text, encoding="utf-8")


if __name__ == "__main__":
    main()
