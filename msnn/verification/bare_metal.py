"""Runs the golden vectors bare-metal in QEMU; measures instructions, memory and stack."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from statistics import median

from msnn.verification.builds.board_build import BoardBuild
from msnn.verification.builds.boards import Board, board_levels
from msnn.verification.builds.call_graph import stack_bound
from msnn.verification.builds.golden_run import differences
from msnn.verification.builds.harness import write_harness
from msnn.verification.exported_c import ExportedC
from msnn.verification.proof_step import Figures, ProofStep, Result
from msnn.verification.tools import GCC

_RETURN = 2
"""Instructions with which the empty step returns its status; they count for the model too."""
_SECONDS = 60.0


def board_checks(model: ExportedC, targets: frozenset[str]) -> Iterator[ProofStep]:
    """One check per board and optimisation level."""
    return (_on_board(board, level, model) for board, level in board_levels(targets))


def _on_board(board: Board, level: str, model: ExportedC) -> ProofStep:
    def run(folder: Path) -> Result:
        # the model at the level that is measured; harness and start-up code always at -O1
        build = BoardBuild(board, level, model, folder)
        write_harness("replay.h", model, folder)
        main = build.object(write_harness("board_main.c", model, folder), ["-O1"])
        answer = build.answer(build.link("golden", [main, *build.objects]), _SECONDS)
        found = differences(model, answer)
        stack = re.search(r"stack ([0-9a-f]{8})", answer)
        # without an answer there is nothing to count
        if found or stack is None:
            return check.of(found or ["no word about the stack"], "golden steps differ")
        painted = int(stack[1], 16)
        # of the step alone: init and reset run once, and are not what a task's stack is laid out
        # for
        bound = stack_bound(sorted(folder.glob("*.ci")), f"{model.prefix}_step")
        # painted is what a run has used, the bound what any run can use
        if bound is not None and painted > bound:
            found.append(f"the stack was {painted} bytes deep, the call graph allows {bound}")
        # another program: the harness of the golden steps would count as the model's
        flash, data, bss = build.added(write_harness("size_main.c", model, folder))
        counts = _instructions(build.counts(), model)
        figures = Figures(
            flags=level,
            instructions=(min(counts), sum(counts) / len(counts), max(counts)),
            median=median(counts),
            flash=flash,
            data=data,
            bss=bss,
            stack_painted=painted,
            stack_bound=bound,
        )
        promise = "0 bits differ" if model.exact else "within the tolerance"
        return check.of(found, f"{len(model.expected)} golden steps: {promise}", [figures])

    needs = (board.compiler, board.emulator, GCC)
    check = ProofStep("golden vectors", f"{board.core} {level}", needs, run)
    return check


def _instructions(counts: list[int], model: ExportedC) -> list[int]:
    """The number of instructions of each step."""
    # the first count is of an empty step: call, loop and reading of the counter
    idle, *rest = counts
    return [count - idle + _RETURN for count in rest[: len(model.expected)]]
