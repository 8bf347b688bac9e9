"""Measures the CPU time of reading, checking and compiling specs.

python benchmarks/language/run.py
"""

from __future__ import annotations

import resource
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

from compiler.elaboration.compile import compile_spec
from msnn.model.load import load_model
from spec_schema.reading.reader import read_spec

ROOT = Path(__file__).parents[2]
DRAFTS = ROOT / "tests" / "language" / "drafts"
EQUATIONS = 2000
CELLS = 10


def main() -> None:
    print("| what | CPU time |")
    print("| --- | --- |")
    for path in sorted(DRAFTS.glob("*.msnn.yaml")):
        name = path.name.removesuffix(".msnn.yaml")
        print(f"| `msnn check` of {name}, a new process | {_command(path):.2f} s |", flush=True)
        print(f"| {name} again in one process | {_milliseconds(partial(load_model, path), 20)} |")
    for what, text in (
        (f"{EQUATIONS} equations", _equations()),
        (f"{EQUATIONS} equations, each needs the next", _chain()),
        (f"{CELLS}×{CELLS} local models", _grid()),
    ):
        print(f"| {what} | {_milliseconds(partial(_compiled, text))} |", flush=True)


def _milliseconds(work: Callable[[], object], times: int = 3) -> str:
    """The shortest of several runs, without the first, as a text."""
    work()
    taken: list[float] = []
    for _ in range(times):
        began = time.process_time()
        work()
        taken.append(time.process_time() - began)
    return f"{1000 * min(taken):.0f} ms"


def _command(path: Path) -> float:
    """Seconds of a process that checks a spec, including its start."""

    def used() -> float:
        children = resource.getrusage(resource.RUSAGE_CHILDREN)
        return children.ru_utime + children.ru_stime

    before = used()
    command = [sys.executable, "-m", "msnn", "check", str(path)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    return used() - before


def _compiled(text: str) -> object:
    return compile_spec(read_spec("measured.yaml", text).spec)


_HEAD = "msnn: 1\nname: measured\nsample_time: 10 ms\ninputs: {u: 1, v: 1}\n"


def _equations() -> str:
    lines = [f"  e{i}: sin({i} * u) * v[t-{i % 7 + 1}] + 0.5" for i in range(EQUATIONS)]
    total = "\n".join(f"  y{i}: e{i}" for i in range(EQUATIONS))
    return f"{_HEAD}equations:\n" + "\n".join(lines) + f"\noutputs:\n{total}\n"


def _chain() -> str:
    lines = [f"  e{i}: 0.5 * e{i + 1} + u" for i in range(EQUATIONS - 1)]
    return (
        f"{_HEAD}equations:\n" + "\n".join(lines) + f"\n  e{EQUATIONS - 1}: v\noutputs: {{y: e0}}\n"
    )


def _grid() -> str:
    return (
        f"{_HEAD}dims: {{a: {CELLS}, b: {CELLS}}}\nlayers:\n"
        f"  phi: {{fuzzify: {{centers: {{linspace: [0, 1, {CELLS}]}}, dim: a}}}}\n"
        f"  psi: {{fuzzify: {{centers: {{linspace: [0, 1, {CELLS}]}}, dim: b}}}}\n"
        "  local: {local_model: {by: [phi(u), psi(v)], cell: {fir: {window: 5}}}}\n"
        "outputs: {y: local(u)}\n"
    )


if __name__ == "__main__":
    main()
