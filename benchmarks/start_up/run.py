"""Tells what `msnn check` of a small spec costs, beside what it is made of and other checkouts.

python benchmarks/start_up/run.py                        # this checkout and its libraries alone
python benchmarks/start_up/run.py ../before 40           # beside another checkout, 40 rounds

Commands take turns, so that what else the machine does meets all of them alike. CPU seconds (user
and system) are those of the process; bytecode is compiled before, as an installation does it.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import median

HERE = Path(__file__).parents[2]
_LIBRARIES = {
    "python alone": "pass",
    "numpy and pydantic": "import numpy; from pydantic import BaseModel",
    "all that it imports of others": (
        "import numpy, typer, yaml; from pydantic import BaseModel, TypeAdapter"
    ),
}
_START = "from msnn.cli.main import main; main()"


def main() -> None:
    rounds = next((int(word) for word in sys.argv[1:] if word.isdigit()), 20)
    others = [Path(word).resolve() for word in sys.argv[1:] if not word.isdigit()]
    with tempfile.TemporaryDirectory() as folder:
        environment = _environment(Path(folder) / "bytecode")
        _run([*_check(HERE)[:3], "init", "plant"], folder, environment | {"PYTHONPATH": str(HERE)})
        commands = {name: ([sys.executable, "-c", text], None) for name, text in _LIBRARIES.items()}
        commands |= {f"check of {tree.name}": (_check(tree), tree) for tree in (HERE, *others)}
        cpu: dict[str, list[float]] = {name: [] for name in commands}
        wall: dict[str, list[float]] = {name: [] for name in commands}
        for number in range(rounds + 1):
            for name, (command, tree) in commands.items():
                found = environment | ({} if tree is None else {"PYTHONPATH": str(tree)})
                took = _run(command, Path(folder) / "plant", found)
                if number:  # the first writes the bytecode
                    cpu[name].append(took[0])
                    wall[name].append(took[1])
    print("| process | CPU, s: least | median | wall, s: least | median |")
    print("| --- | --- | --- | --- | --- |")
    for name in commands:
        row = [f(all) for all in (cpu[name], wall[name]) for f in (min, median)]
        print(f"| {name} | {' | '.join(f'{value:.3f}' for value in row)} |")


def _environment(bytecode: Path) -> dict[str, str]:
    """Environment variables without those that would recompile every module or start threads."""
    kept = {name: value for name, value in os.environ.items() if "BYTECODE" not in name}
    return kept | {"PYTHONPYCACHEPREFIX": str(bytecode), "OPENBLAS_NUM_THREADS": "1"}


def _check(tree: Path) -> list[str]:
    python = tree / ".venv" / "bin" / "python"
    return [str(python if python.exists() else sys.executable), "-c", _START, "check", "."]


def _run(
    command: Sequence[str], folder: str | Path, environment: Mapping[str, str]
) -> tuple[float, float]:
    """CPU seconds and seconds of a process; it must end with exit code 0."""
    began = time.perf_counter()
    process = subprocess.Popen(
        command, cwd=folder, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
    )
    _, status, used = os.wait4(process.pid, 0)
    took = time.perf_counter() - began
    assert status == 0, process.stderr and process.stderr.read()
    process.returncode = 0
    return used.ru_utime + used.ru_stime, took


if __name__ == "__main__":
    main()
