"""Verifies the C of every spec of the gallery on this machine and on all boards; prints a table.

`gallery.py [NAME…]`. Needs what `msnn verify --targets all --proof --misra` needs.
"""

from __future__ import annotations

import sys
import tempfile
from contextlib import redirect_stdout
from pathlib import Path

from msnn.cli.application import run
from msnn.verification.proof_step import Figures, Result
from msnn.verification.verify import TARGETS, Verification, WantedSteps, verify

GALLERY = Path(__file__).parents[2] / "examples" / "gallery"
_BOARDS = ("Cortex-M4F", "Cortex-M0", "RV32IMAFC")
"""Whose figures are shown: all boards are verified."""


def main() -> None:
    names = sys.argv[1:] or sorted(p.name.split(".")[0] for p in GALLERY.glob("*.msnn.yaml"))
    head = ["model", "board", "instructions (least, most)", "flash", "RAM", "stack (bound)"]
    print("| " + " | ".join([*head, "found"]) + " |")
    print("|" + " --- |" * (len(head) + 1), flush=True)
    for name in names:
        with redirect_stdout(sys.stderr), tempfile.TemporaryDirectory() as place:
            spec = str(GALLERY / f"{name}.msnn.yaml")
            if run(["export", spec, "--initial", "--to", "c", "--out", place]) != 0:
                raise SystemExit(f"{name} was not exported")
            wanted = WantedSteps(targets=frozenset(TARGETS), proof=True, misra=True)
            found = verify(Path(place) / "c", wanted)
        for row in _rows(name, found):
            print("| " + " | ".join(row) + " |", flush=True)


def _rows(name: str, found: Verification) -> list[list[str]]:
    """The measurements at -Os; the first row also has all findings."""
    rows: list[list[str]] = []
    for board in _BOARDS:
        for figures in _figures(found, board):
            least, mean, most = figures.instructions
            bound = "none" if figures.stack_bound is None else str(figures.stack_bound)
            count = f"{mean:.1f} ({least}, {most})"
            ram = str(figures.data + figures.bss)
            stack = f"{figures.stack_painted} ({bound})"
            rows.append([name, board, count, str(figures.flash), ram, stack, ""])
    wrong = [result for result in found.results if result.verdict != "ok"]
    rows[0][-1] = "; ".join(map(_said, wrong)) or f"nothing in {len(found.results)} checks"
    return rows


def _figures(found: Verification, board: str) -> list[Figures]:
    return [
        figures
        for result in found.results
        if result.target == f"{board} -Os"
        for figures in result.figures
    ]


def _said(result: Result) -> str:
    return f"{result.check}, {result.target}: {result.detail}"


if __name__ == "__main__":
    main()
