"""Times generated controllers beside the prototype of their method, in one interleaved run.

    python benchmarks/mpc/run.py [repetitions]

The plant is the network of `prototypes/w.h`. Both solve the same closed loops with 2,000 recorded
disturbances and with 2,000 fresh ones; each solve counts with the shortest of its repetitions, and
only where an independent evaluation finds the optimality conditions to 1e-6.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from msnn.features.control.backend.write_controller import write_controller
from msnn.features.control.problem.optimal_control import ControlProblem
from msnn.model.load import load_model
from msnn.tables import table_text

HERE = Path(__file__).resolve().parent
FRESH_SEED = 20261122
FLAGS = ("-O2", "-ffp-contract=off", "-D_POSIX_C_SOURCE=200809L", "-w")


def main() -> None:
    """Generates, compiles, runs and prints."""
    repetitions = sys.argv[1] if len(sys.argv) > 1 else "5"
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        _generate(folder)
        lines = _run(folder, repetitions)
        _print(lines)
        _print_sizes(folder)


def _generate(folder: Path) -> None:
    problem = load_model(HERE / "mlp.msnn.yaml").of(ControlProblem)
    assert problem is not None
    weights = network_weights()
    write_controller(problem, weights, folder / "plant", prefix="plant", dtype="float64")
    five = replace(problem, mode="fixed", iterations=5)
    write_controller(five, weights, folder / "quick", prefix="quick", dtype="float64")
    random = np.random.default_rng(FRESH_SEED)
    draws = random.normal(size=(2000, 2)) * [0.25, 1.0]
    numbers = ",".join(repr(float(x)) for x in draws.ravel())
    (folder / "draws.h").write_text(f"static const double FRESH[4000]={{{numbers}}};\n")


def network_weights() -> dict[str, NDArray[np.float64]]:
    text = (HERE / "prototypes" / "w.h").read_text()

    def numbers(name: str, *shape: int) -> NDArray[np.float64]:
        found = re.search(rf"\b{name}\[\d+\]=\{{([^}}]*)\}}", text)
        assert found is not None, name
        return np.array([float(x) for x in found[1].split(",")]).reshape(shape)

    return {
        "net.weight1": numbers("W1T", 3, 16).T,
        "net.bias1": numbers("B1", 16),
        "net.weight2": numbers("W2T", 16, 16).T,
        "net.bias2": numbers("B2", 16),
        "net.weight3": numbers("W3R", 2, 16),
        "net.bias3": numbers("B3", 2),
    }


def _run(folder: Path, repetitions: str) -> list[list[str]]:
    program = folder / "interleaved"
    sources = [str(p) for name in ("plant", "quick") for p in (folder / name / "src").glob("*.c")]
    includes = [f"-I{folder / name / 'include'}" for name in ("plant", "quick")]
    command = ["gcc", "-std=c99", *FLAGS, *includes, f"-I{folder}", str(HERE / "interleaved.c")]
    subprocess.run([*command, *sources, "-o", str(program), "-lm"], check=True)
    done = subprocess.run([str(program), repetitions], check=True, capture_output=True, text=True)
    return [line.split("|") for line in done.stdout.splitlines()]


def _print(lines: list[list[str]]) -> None:
    rows: list[tuple[str, ...]] = []
    base: dict[tuple[str, int], list[float]] = {}
    results = [line for line in lines if line[0] != "struct"]
    for number, line in enumerate(results):
        name, kind, *values = line
        times = [float(x) * 1e3 for x in values[:4]]
        place = (name, number % 3)
        base.setdefault(place, times)
        first = base[place]
        cells = [f"{t:.1f} ({t / b:.2f})" for t, b in zip(times[:3], first[:3], strict=True)]
        # from the measurement on, the prototype needs its whole time
        cells.append(f"{times[3]:.2f} ({times[3] / first[0]:.3f})")
        rows.append((name, kind, *cells, f"{float(values[4]):.2f}", *values[5:]))
    header = ("set", "solver", "median", "p99", "longest", "to control", "iterations")
    print(table_text((*header, "failed", "cost", "resets"), rows, numbers=list(range(2, 10))))
    print(
        "times in us, in parentheses by the prototype of the same kind; `failed` counts plans that"
    )
    print("are not optimal to 1e-6, of five and one iterations of the prototype nearly all")
    print(f"memory of a controller: {lines[-1][1]} bytes")


def _print_sizes(folder: Path) -> None:
    for source in sorted((folder / "plant" / "src").glob("plant_mpc*.c")):
        object_file = folder / f"{source.stem}.o"
        include = f"-I{folder / 'plant' / 'include'}"
        command = ["gcc", "-std=c99", "-Os", "-ffp-contract=off", include, "-c", str(source)]
        subprocess.run([*command, "-o", str(object_file)], check=True)
        done = subprocess.run(
            ["size", str(object_file)], check=True, capture_output=True, text=True
        )
        print(
            f"{source.name}: {done.stdout.splitlines()[1].split()[0]} bytes of code and tables, -Os"
        )


if __name__ == "__main__":
    main()
