"""Trains both models on four draws of the data and writes what they reach.

    python results.py       # writes results.json and the tables of README.md

The first draw is that of `generate_data.py`; the others have other seeds.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import msnn

HERE = Path(__file__).resolve().parent
SEEDS = (20240229, 1, 2, 3)
FIR, PHYSICAL = HERE / "msd.msnn.yaml", HERE / "msd_physical.msnn.yaml"
TRUE = {"mass": (2, "kg"), "damping": (1.5, "N s/m"), "stiffness": (12, "N/m")}
ONE_TAP = ["layers.h_F.fir.window=1"]
BY_ADAM = ["train=[{epochs: 100, optimizer: {adam: {lr: 0.001}}}]"]

Results = dict[str, Any]


def main() -> None:
    """Measures, and writes both files."""
    with tempfile.TemporaryDirectory() as folder:
        found = measured(Path(folder))
    text = json.dumps(found, indent=1)
    (HERE / "results.json").write_text(f"{text}\n", encoding="utf-8")
    page = HERE / "README.md"
    page.write_text(with_tables(page.read_text(encoding="utf-8"), found), encoding="utf-8")


def measured(folder: Path) -> Results:
    """What each model reaches on each draw; of variants on the first alone."""
    found: Results = {"taps": [], "physical": []}
    for seed in SEEDS:
        data = folder / str(seed)
        command = [sys.executable, HERE / "generate_data.py", "--out", data, "--seed", str(seed)]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        found["taps"].append(trained(FIR, data))
        found["physical"].append(trained(PHYSICAL, data))
    first = folder / str(SEEDS[0])
    found["one tap of the force"] = trained(FIR, first, ONE_TAP)
    found["by adam"] = trained(FIR, first, BY_ADAM)
    return found


def trained(spec: Path, data: Path, settings: list[str] | None = None) -> dict[str, float]:
    """Errors in metres by their rollouts, and the learned coefficients."""
    source = f"data.source={{train: {data}/train/*.csv, test: {data}/test/*.csv}}"
    model = msnn.load(spec, [source, *(settings or [])])
    result = msnn.train(model, runs=None)
    report = msnn.validate(model, result.weights)
    errors = {row.horizon: row.value for row in report.rows}
    learned = {name: float(result.weights[name]) for name in TRUE if name in result.weights}
    return {name: float(f"{value:.6g}") for name, value in (errors | learned).items()}


def with_tables(page: str, found: Results) -> str:
    """The page with its tables written anew."""
    before, _, rest = page.partition("<!-- figures -->\n")
    after = rest.partition("<!-- end -->\n")[2]
    return f"{before}<!-- figures -->\n\n{tables(found)}\n\n<!-- end -->\n{after}"


def tables(found: Results) -> str:
    """Of each model a row a figure: here, the limit or the truth, and with other data."""
    taps, physical = found["taps"], found["physical"]
    one, variant, adam = "1", found["one tap of the force"], found["by adam"]
    rollout = next(name for name in taps[0] if name != one)
    rows = [
        "| taps | here | limit | other data |",
        "|---|---|---|---|",
        _error("one-step error, rms", one, taps, "2 mm"),
        _error("error of 5 s rollouts, rms", rollout, taps, "10 mm"),
        _error("one-step error with F[t] alone", one, [variant], "2 mm"),
        _error("one-step error after 100 epochs of Adam at 1e-3", one, [adam], "2 mm"),
        "",
        "| physical | learned | true | other data |",
        "|---|---|---|---|",
        *(_coefficient(name, physical) for name in TRUE),
        _error("error of 5 s rollouts, rms", rollout, physical, "10 mm"),
    ]
    return "\n".join(rows)


def _error(title: str, horizon: str, draws: list[dict[str, float]], limit: str) -> str:
    first, *others = [1000 * draw[horizon] for draw in draws]
    more = f"{min(others):.2f} to {max(others):.2f} mm" if others else ""
    return f"| {title} | {first:.2f} mm | {limit} | {more} |"


def _coefficient(name: str, draws: list[dict[str, float]]) -> str:
    true, unit = TRUE[name]
    first, *others = [draw[name] for draw in draws]
    more = f"{min(others):.3f} to {max(others):.3f} {unit}"
    return f"| {name} | {first:.3f} {unit} | {true:g} {unit} | {more} |"


if __name__ == "__main__":
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    main()
