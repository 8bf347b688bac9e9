"""Measures the structure of a checkout: its size, and how much of it two commands enter.

    python -m benchmarks.structure.measure [CHECKOUT]

CHECKOUT is a folder with an environment (`make setup`); by default this one. The figures are read
by people, not compared by a test: counts can be met by joining files that do not belong together.
"""

from __future__ import annotations

import ast
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGES = ("spec_schema", "compiler", "backends", "msnn")
SPEC = """\
msnn: 1
name: plant
sample_time: 0.1 s
inputs: {u: {}, y: {}}
parameters: {a: 0.5, b: 1}
outputs:
  y_next: {expr: "a * y + b * u", predicts: "y[t+1]"}
"""
_PROFILED = """
import sys, threading
root = sys.argv.pop(1) + "/"
packages = tuple(root + name + "/" for name in sys.argv.pop(1).split(","))
entered = set()
def note(frame, event, argument):
    code = frame.f_code
    if event == "call" and code.co_filename.startswith(packages) and code.co_name[0] != "<":
        entered.add((code.co_filename, code.co_qualname))
threading.setprofile(note)
sys.setprofile(note)
from msnn.cli.application import run
run(sys.argv[1:])
sys.setprofile(None)
print(len(entered), len({file for file, _ in entered}), file=sys.stderr)
"""
"""Counts functions and files of msnn that a command enters; bodies of modules do not count."""


def main(checkout: Path) -> None:
    """Prints the table of one checkout."""
    files = [path for package in PACKAGES for path in sorted((checkout / package).rglob("*.py"))]
    lines = [line for file in files for line in file.read_text("utf-8").splitlines()]
    rows = [
        ("files of Python", len(files)),
        ("lines", len(lines)),
        ("lines of imports", sum(_import_lines(file) for file in files)),
        ("files with fewer than 25 lines beside imports", sum(map(_is_small, files))),
        ("rooms (folders with modules)", len({file.parent for file in files})),
        ("folders that predictive control touches", len(set(_of_control(files)))),
        ("decision records", _decisions(checkout)),
    ]
    for name, command in (
        ("check", ("check", "plant.msnn.yaml")),
        ("export --to c", ("export", "--initial", "--to", "c", "plant.msnn.yaml")),
    ):
        functions, entered = _entered(checkout, command)
        rows += [(f"`{name}` enters functions", functions), (f"`{name}` enters files", entered)]
    width = max(len(name) for name, _ in rows)
    for name, value in rows:
        print(f"{name:{width}}  {value:>7,}")


def _import_lines(file: Path) -> int:
    tree = ast.parse(file.read_text("utf-8"))
    imports = (node for node in ast.walk(tree) if isinstance(node, ast.Import | ast.ImportFrom))
    return sum((node.end_lineno or node.lineno) - node.lineno + 1 for node in imports)


def _is_small(file: Path) -> bool:
    text = file.read_text("utf-8")
    filled = sum(bool(line.strip()) for line in text.splitlines())
    return filled - _import_lines(file) < 25 and file.name != "__init__.py"


def _of_control(files: list[Path]) -> Iterator[Path]:
    """Yields the folders with files that import an optimal control or estimation problem."""
    words = ("optimal_control", "state_estimation", "moving_horizon", "features.control")
    for file in files:
        imports = (line for line in file.read_text("utf-8").splitlines() if "import " in line)
        if any(word in line for line in imports for word in words):
            inside = file.parent.parts
            is_feature = "features" in inside
            yield file.parent if not is_feature else Path(*inside[: inside.index("features") + 2])


def _decisions(checkout: Path) -> int:
    """The number of decision records."""
    pages = (page for package in PACKAGES for page in (checkout / package).rglob("decisions.md"))
    headings = sum(page.read_text("utf-8").count("\n## 0") for page in pages)
    return headings + len(list((checkout / "docs/decisions").rglob("0*.md")))


def _entered(checkout: Path, command: tuple[str, ...]) -> tuple[int, int]:
    """The numbers of functions and of files of msnn that a command runs."""
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "plant.msnn.yaml").write_text(SPEC, "utf-8")
        python = checkout / ".venv/bin/python"
        arguments = [python, "-c", _PROFILED, str(checkout), ",".join(PACKAGES), *command]
        done = subprocess.run(arguments, cwd=folder, capture_output=True, text=True, check=True)
    functions, files = done.stderr.splitlines()[-1].split()
    return int(functions), int(files)


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve() if len(sys.argv) > 1 else ROOT)
