"""Compares the models that `msnn init --data` and `msnn train` make with least squares by numpy.

    python benchmarks/data/first_models.py [--only NAME] [--write]

`--write` writes first_models.md. Nobody edits the specs: each recording goes through `init`,
`train` and `validate`. The last fifth of each recording is held out.
"""

from __future__ import annotations

import argparse
import re
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))

from benchmarks.data.known_systems import SYSTEMS, Array, filtered, steps
from msnn.api import measurements, models, trainings
from msnn.data.dataset import Dataset
from msnn.features.data_check.first_spec.new_spec import new_project_from
from msnn.model.model import Model
from msnn.model.model_data import read_data
from msnn.model.weights.weights_file import Weights

ROOT = Path(__file__).resolve().parents[2]
DRONE = ROOT.parent / "shared" / "data" / "quarter_drone"
_WORSE = 1.01
"""Ratio to the error of least squares above which a trained model is listed as worse."""

_COLUMNS = (
    "recording | predicted | inputs | order | trained | first spec | least squares | constant "
    "| new: trained | new: first spec"
)
_HEAD = (f"| {_COLUMNS} |", "|---" * 10 + "|")
_PAGE = """\
# First models against least squares

Written by `python benchmarks/data/first_models.py --write`. Each recording goes through
`msnn init --data`, `msnn train` and `msnn validate`; nobody edits the spec.

The last columns are RMS errors of the simulation of the last fifth, which least squares does not
use: of the trained model, of the spec that `init` writes, of the ARX model with the same inputs,
delays and orders that `numpy.linalg.lstsq` fits to the other rows, and of the mean of those rows.
The weights in a spec have fewer digits than those of numpy. Training and the choice of orders use
the last fifth too, as validation rows. "New" is a recording of the same system by another seed,
which nothing has read.

{rows}

## Worse than least squares by more than 1 %

{worse}

Six models of the oscillator (seeds 0, 10, … 50), each on eight new recordings, differ from least
squares by −3.9 to +5.6 %, on average by −0.3 %. With 400 rows for up to 25 weights, a difference of
2 % is chance.
"""


@dataclass(frozen=True, slots=True)
class Term:
    """The FIR layer of one signal in an equation: lags `first` to `first + window − 1`."""

    signal: str
    first: int
    window: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Compared:
    """RMS errors of simulations of one target, over the held-out rows."""

    recording: str
    target: str
    inputs: tuple[str, ...]
    order: int
    trained: float
    first: float
    """Of the spec as `init` writes it."""
    least_squares: float
    constant: float
    new: tuple[float, float] | None
    """Of a simulated recording that nothing has read: trained, first spec."""

    @property
    def pairs(self) -> list[tuple[str, float, float]]:
        """Rows, error of the trained model, error of least squares."""
        last = ("last fifth", self.trained, self.least_squares)
        return [last] if self.new is None else [last, ("new recording", *self.new)]


def main() -> None:
    """Prints the page."""
    parser = argparse.ArgumentParser(description="Compares first models with least squares.")
    parser.add_argument("--only", help="the name of one recording")
    parser.add_argument("--write", action="store_true")
    given = parser.parse_args()
    if given.write and (given.only or not DRONE.is_dir()):
        parser.error("the page needs all recordings")
    found: list[Compared] = []
    for name in RECORDINGS if given.only is None else [given.only]:
        found += compared(name)
        print(name, file=sys.stderr)
    page = _page(found)
    print(page)
    if given.write:
        Path(__file__).with_suffix(".md").write_text(page, encoding="utf-8")


def _page(found: Sequence[Compared]) -> str:
    rows = [
        f"| {c.recording} | {c.target} | {', '.join(c.inputs) or 'none'} | {c.order} "
        f"| {c.trained:.4g} | {c.first:.4g} | {c.least_squares:.4g} | {c.constant:.4g} "
        f"| {' | ' if c.new is None else f'{c.new[0]:.4g} | {c.new[1]:.4g}'} |"
        for c in found
    ]
    worse = [
        f"| {c.recording} | {c.target} | {rows} | {trained:.4g} | {linear:.4g} "
        f"| {trained / linear - 1:+.1%} |"
        for c in found
        for rows, trained, linear in c.pairs
        if not trained <= _WORSE * linear
    ]
    head = [
        "| recording | predicted | rows | trained | least squares | difference |",
        "|---|---|---|---|---|---|",
    ]
    return _PAGE.format(
        rows="\n".join([*_HEAD, *rows]), worse="\n".join([*head, *worse] if worse else ["None."])
    )


def compared(name: str) -> list[Compared]:
    """The errors of one recording, for each of its targets."""
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        files, targets = RECORDINGS[name](folder, 0)
        path, _ = new_project_from(folder / "plant", files, targets)
        spec = next(path.glob("*.msnn.yaml")) if path.is_dir() else path
        model = models.load(spec)
        terms = terms_of(spec.read_text(encoding="utf-8"), targets)
        data = read_data(model, None, "validation")
        simulated = least_squares(data, terms)
        weights = trainings.train(model, runs=None).weights
        errors = [_errors(model, each, None) for each in (weights, None)]
        new: list[list[float]] = []
        if files[0].parent == folder:
            (folder / "new").mkdir()
            (file,), _ = RECORDINGS[name](folder / "new", 1)
            new = [_errors(model, each, _frame(file)) for each in (weights, None)]
        train = data.in_set("train")
        return [
            Compared(
                recording=name,
                target=target,
                inputs=tuple(t.signal for t in terms[target] if t.signal not in targets),
                order=terms[target][0].window,
                trained=errors[0][number],
                first=errors[1][number],
                new=(new[0][number], new[1][number]) if new else None,
                least_squares=_rms(simulated[target] - data.series[target]),
                constant=_rms(
                    np.where(np.isnan(simulated[target]), np.nan, data.series[target])
                    - float(np.nanmean(data.series[target][train]))
                ),
            )
            for number, target in enumerate(targets)
        ]


def _errors(model: Model, weights: Weights | None, new: dict[str, Array] | None) -> list[float]:
    """RMS errors of simulations of the last fifth, or of a whole new recording."""
    data = None if new is None else {"val": new}
    rows = measurements.validate(model, weights, data).rows
    return [row.value for row in rows if row.horizon == "record"]


def _frame(file: Path) -> dict[str, Array]:
    header = file.read_text(encoding="utf-8").partition("\n")[0]
    values = np.loadtxt(file, delimiter=",", skiprows=1)
    return dict(zip(header.split(","), values.T, strict=True))


def terms_of(spec: str, targets: Sequence[str]) -> dict[str, list[Term]]:
    """The FIR layers in the equation of each target, read from the text of a first spec."""
    windows = {n: int(w) for n, w in re.findall(r"^  (\w+): \{fir: \{window: (\d+)", spec, re.M)}
    found: dict[str, list[Term]] = {}
    for target in targets:
        linear = f"{target}_linear" if len(targets) > 1 else "linear"
        line = re.search(rf"^  {linear}: (.*)$", spec, re.M)
        assert line is not None, spec
        calls = re.findall(r"(\w+)\((\w+)(?:\[t-(\d+)\])?\)", line[1])
        found[target] = [Term(s, int(late or 0) + 1, windows[layer]) for layer, s, late in calls]
    return found


def least_squares(data: Dataset, terms: Mapping[str, Sequence[Term]]) -> dict[str, Array]:
    """Simulations of whole recordings by ARX equations that are fitted to the training rows.

    They begin with the first measured lags, as `rollout: record` does. Values are NaN outside of
    the validation rows.
    """
    series = {t.signal: data.series[t.signal] for each in terms.values() for t in each}
    depth = max(t.first + t.window - 1 for each in terms.values() for t in each)
    weights = {target: _fitted(data, target, each) for target, each in terms.items()}
    found = {target: np.full(data.rows, np.nan) for target in terms}
    for start, stop in data.stretches().tolist():
        past = {name: values[start:stop].copy() for name, values in series.items()}
        for t in range(depth, stop - start):
            values = {
                target: float(np.append(_lags(past, each, t), 1.0) @ weights[target])
                for target, each in terms.items()
            }
            for target, value in values.items():
                past[target][t] = found[target][start + t] = value
    held_out = data.in_set("val")
    return {target: np.where(held_out, values, np.nan) for target, values in found.items()}


def _fitted(data: Dataset, target: str, terms: Sequence[Term]) -> Array:
    depth = max(t.first + t.window - 1 for t in terms)
    rows = [
        row
        for start, stop in data.episodes("train").tolist()
        for row in range(start + depth, stop)
        if np.isfinite(data.series[target][row])
    ]
    regressors = np.stack([np.append(_lags(data.series, terms, row), 1.0) for row in rows])
    solution = np.linalg.lstsq(regressors, data.series[target][rows], rcond=None)[0]
    return np.asarray(solution, np.float64)


def _lags(series: Mapping[str, Array], terms: Sequence[Term], row: int) -> Array:
    """The lags of all terms before a row, the newest of each first."""
    return np.concatenate(
        [series[t.signal][row - t.first - t.window + 1 : row - t.first + 1][::-1] for t in terms]
    )


def _rms(values: Array) -> float:
    return float(np.sqrt(np.nanmean(values**2)))


Recording = Callable[[Path, int], tuple[list[Path], list[str]]]
"""Writes a simulation by a seed into a folder; gives the files and the predicted columns."""


def _written(folder: Path, columns: Mapping[str, Array]) -> list[Path]:
    table = np.stack([np.arange(len(next(iter(columns.values())))), *columns.values()], axis=1)
    header = ",".join(["time", *columns])
    np.savetxt(folder / "log.csv", table, fmt="%.9g", delimiter=",", header=header, comments="")
    return [folder / "log.csv"]


def _system(name: str) -> Recording:
    def recording(folder: Path, seed: int) -> tuple[list[Path], list[str]]:
        case = SYSTEMS[name](np.random.default_rng(seed))
        # names without a hint at what a column is
        inputs = {f"u{number + 1}": case.inputs[:, number] for number in range(len(case.acts))}
        return _written(folder, {**inputs, "y": case.target}), ["y"]

    return recording


def _two_by_two(folder: Path, seed: int) -> tuple[list[Path], list[str]]:
    """Two coupled outputs, of which the second is a thousand times as large, and two inputs."""
    random = np.random.default_rng(seed)
    u, w = steps(random, 2_500), steps(random, 2_500)
    x, z = np.zeros(2_500), np.zeros(2_500)
    for t in range(1, 2_500):
        x[t] = 0.9 * x[t - 1] + 0.05 * z[t - 1] + 0.1 * u[t - 1]
        z[t] = 0.85 * z[t - 1] - 0.05 * x[t - 1] + 0.15 * w[t - 1] + 0.05 * u[t - 1]
    x += 0.02 * random.normal(size=2_500)
    z += 0.02 * random.normal(size=2_500)
    return _written(folder, {"u": u, "w": w, "x": x, "z": 1000 * z}), ["x", "z"]


def _vibration(folder: Path, seed: int) -> tuple[list[Path], list[str]]:
    """Five lightly damped modes behind one force."""
    random = np.random.default_rng(seed)
    u = random.normal(size=4_000)
    y = np.zeros(4_000)
    for angle in (0.3, 0.8, 1.3, 1.9, 2.5):
        y += filtered([0.0, 1.0], [1, -2 * 0.985 * np.cos(angle), 0.985**2], u)
    y += 0.001 * np.std(y) * random.normal(size=4_000)
    return _written(folder, {"u": u, "y": y}), ["y"]


def _tank(folder: Path, seed: int) -> tuple[list[Path], list[str]]:
    """A level that integrates inflow minus outflow; the pump runs by a two-point controller."""
    random = np.random.default_rng(seed)
    outflow = 0.5 + 0.3 * steps(random, 2_000, 20, 80)
    level, inflow, runs = np.zeros(2_000), np.zeros(2_000), True
    level[0] = 50
    for t in range(2_000):
        if t:
            level[t] = level[t - 1] + 0.5 * (inflow[t - 1] - outflow[t - 1])
        runs = level[t] < 55 if runs else level[t] < 45
        inflow[t] = 1.2 * runs
    level += 0.1 * random.normal(size=2_000)
    return _written(folder, {"inflow": inflow, "outflow": outflow, "level": level}), ["level"]


def _short(folder: Path, seed: int) -> tuple[list[Path], list[str]]:
    random = np.random.default_rng(seed)
    u = steps(random, 120)
    y = filtered([0.0, 0.15], [1, -0.85], u) + 0.02 * random.normal(size=120)
    return _written(folder, {"u": u, "y": y}), ["y"]


def _without_input(folder: Path, seed: int) -> tuple[list[Path], list[str]]:
    random = np.random.default_rng(seed)
    y = filtered([1.0], [1, -1.6, 0.8], random.normal(size=1_500))
    return _written(folder, {"y": y}), ["y"]


def _kept(*files: Path, predicted: str) -> Recording:
    return lambda folder, seed: (list(files), [predicted])


_CI = ROOT / "examples" / "ci" / "records"


def _recordings() -> Iterator[tuple[str, Recording]]:
    yield "short, 120 rows", _short
    for name in SYSTEMS:
        yield name, _system(name)
    yield "two outputs, two inputs", _two_by_two
    yield "vibration, five modes", _vibration
    yield "integrating tank", _tank
    yield "no input", _without_input
    for name, predicted in (("heater", "T"), ("motor", "w")):
        files = [_CI / name / f"{part}.csv" for part in ("train_1", "train_2", "test")]
        yield f"examples: {name}", _kept(*files, predicted=predicted)
    for name in ("sinal2_degraus", "sinal3_swept_sine", "sinal4_multiseno"):
        file = DRONE / f"{name}_malha_fechada.csv"
        if file.is_file():
            yield f"drone arm: {name}", _kept(file, predicted="Saida_y")


RECORDINGS: Mapping[str, Recording] = dict(_recordings())
"""By name; the recordings of the drone arm are not part of the repository."""


if __name__ == "__main__":
    main()
