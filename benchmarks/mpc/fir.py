"""Times condensed controllers of a FIR plant beside the prototype of their method, interleaved.

    python benchmarks/mpc/fir.py [repetitions]

The plant is that of `prototypes/fw.h`: 30 samples of the control, blended by a measured speed. All
solve the same closed loops over 2,000 samples: a small sine, steps that reach the bounds, and steps
and speeds drawn after the constants of the solver were settled. Each solve counts with the shortest
of its repetitions, and only where an independent evaluation finds its optimality conditions to
1e-6.
"""

from __future__ import annotations

import json
import re
import shutil
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
FRESH_SEED = 20261126
FLAGS = ("-O2", "-ffp-contract=off", "-D_POSIX_C_SOURCE=200809L", "-w")
NAMES = ("condensed", "staged")
BOARD = ("-mcpu=cortex-m4", "-mthumb", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard")


def main() -> None:
    """Generates, compiles, runs and prints."""
    repetitions = sys.argv[1] if len(sys.argv) > 1 else "3"
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        _generate(folder)
        _print(_run(folder, repetitions))
        _print_sizes(folder)


def _generate(folder: Path) -> None:
    problem = load_model(HERE / "fir.msnn.yaml").of(ControlProblem)
    assert problem is not None
    weights = _weights()
    for name in NAMES:
        own = replace(problem, structure=name)
        write_controller(own, weights, folder / name, prefix=name, dtype="float64")
    write_controller(problem, weights, folder / "board", prefix="board", dtype="float32")
    about = json.loads((folder / "condensed" / "condensed_mpc.json").read_text())
    random = np.random.default_rng(FRESH_SEED)
    steps: list[float] = []
    while len(steps) < 2100:
        steps += [float(random.uniform(-4, 4))] * int(random.integers(5, 40))
    speeds = np.clip(15 + np.cumsum(random.normal(size=2100)) * 0.5, 0, 30)
    (folder / "steps.h").write_text(
        f"static const double STEPS[] = {{{','.join(map(repr, steps))}}};\n"
        f"static const double SPEEDS[] = {{{','.join(repr(float(x)) for x in speeds)}}};\n"
        f"enum {{ PLAN_U = {about['plan']['places'][-1]} }};\n"
    )


def _weights() -> dict[str, NDArray[np.float64]]:
    text = (HERE / "prototypes" / "fw.h").read_text()

    def numbers(name: str, *shape: int) -> NDArray[np.float64]:
        found = re.search(rf"\b{name}\[\d+\]=\{{([^}}]*)\}}", text)
        assert found is not None, name
        return np.array([float(x) for x in found[1].split(",")]).reshape(shape)

    return {"a": numbers("AA", 3), "local.weight": numbers("WF", 3, 30)}


def _run(folder: Path, repetitions: str) -> list[list[str]]:
    program = folder / "interleaved"
    sources = [str(p) for name in NAMES for p in (folder / name / "src").glob("*.c")]
    includes = [f"-I{folder / name / 'include'}" for name in NAMES]
    command = ["gcc", "-std=c99", *FLAGS, *includes, f"-I{folder}", str(HERE / "interleaved_fir.c")]
    subprocess.run([*command, *sources, "-o", str(program), "-lm"], check=True)
    done = subprocess.run([str(program), repetitions], check=True, capture_output=True, text=True)
    return [line.split("|") for line in done.stdout.splitlines()]


def _print(lines: list[list[str]]) -> None:
    rows: list[tuple[str, ...]] = []
    base: dict[str, list[float]] = {}
    for name, kind, *values in lines[:-1]:
        times = [float(x) * 1e3 for x in values[:4]]
        first = base.setdefault(name, times)
        cells = [f"{t:.1f} ({t / b:.2f})" for t, b in zip(times[:3], first[:3], strict=True)]
        rows.append((name, kind, *cells, f"{times[3]:.2f}", f"{float(values[4]):.2f}", *values[5:]))
    header = ("set", "solver", "median", "p99", "longest", "to control", "iterations", "most")
    print(table_text((*header, "failed", "cost"), rows, numbers=list(range(2, 10))))
    print("times in us, in parentheses by the prototype's")
    print(f"memory in double precision: condensed {lines[-1][1]}, staged {lines[-1][2]} bytes")


def _print_sizes(folder: Path) -> None:
    if shutil.which("arm-none-eabi-gcc") is None:
        print("no arm-none-eabi-gcc: nothing is compiled for a Cortex-M4F")
        return
    compiler = ["arm-none-eabi-gcc", *BOARD, "-std=c99", "-Os", "-ffp-contract=off", "-c"]
    include = f"-I{folder / 'board' / 'include'}"
    probe = folder / "probe.c"
    probe.write_text('#include "board_mpc.h"\nboard_mpc_t controller;\n')
    sources = [probe, *sorted((folder / "board" / "src").glob("board_mpc*.c"))]
    for source in sources:
        made = folder / f"{source.stem}.o"
        usage = ["-fstack-usage"] if source != probe else []
        subprocess.run([*compiler, *usage, include, str(source), "-o", str(made)], check=True)
        done = subprocess.run(
            ["arm-none-eabi-size", str(made)], check=True, capture_output=True, text=True
        )
        text, _, bss = done.stdout.splitlines()[1].split()[:3]
        if source == probe:
            print(f"Cortex-M4F, float32: {bss} bytes of memory of a controller")
        else:
            print(f"{source.name}: {text} bytes of code and tables, -Os")


if __name__ == "__main__":
    main()
