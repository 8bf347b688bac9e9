"""Runs the self-tests of a controller and a filter bare-metal in QEMU, each call measured."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from statistics import median

from msnn.features.control.verification.exported_controller import ExportedController
from msnn.features.control.verification.host import prefixes, promise, selftest_faults
from msnn.verification.boards import Board, board_levels
from msnn.verification.harness import write_template
from msnn.verification.proof_step import GCC, Figures, ProofStep, Result, ToolFailedError
from msnn.verification.qemu import BoardBuild, stack_bound

_SECONDS = 600.0
_NOUNS = {"solve": "solve", "correct": "correction"}
_CALL = re.compile(r"^call (\w+) ([0-9a-f]{8}) ([0-9a-f]{8}) ([0-9a-f]{8})", re.MULTILINE)
_SELFTEST = re.compile(r"^selftest (\w+) ([0-9a-f]{8})", re.MULTILINE)
_TOO_LARGE = re.compile(r"region `(\w+)' overflowed by (\d+) bytes")


@dataclass(frozen=True, slots=True, kw_only=True)
class _Call:
    """One measured call on a board: its status, iterations, stack depth in bytes and executed
    instructions.
    """

    name: str
    status: int
    iterations: int
    stack: int
    instructions: int


def online_board_checks(model: ExportedController, targets: frozenset[str]) -> Iterator[ProofStep]:
    """One check for each board in `targets` and optimisation level: the self-tests run in QEMU."""
    return (_on_board(board, level, model) for board, level in board_levels(targets))


def _on_board(board: Board, level: str, model: ExportedController) -> ProofStep:
    def run(folder: Path) -> Result:
        build = BoardBuild(board, level, model, folder)
        calls = _measured(model)
        names = prefixes(model)
        main = write_template(
            "online/board_main.c", folder, prefixes=names, calls=calls, controller=model.controller
        )
        # the linker leads each call through a wrapper that measures it, so that the C stays as
        # exported
        wraps = [f"-Wl,--wrap={call['name']}" for call in calls]
        try:
            program = build.link("golden", [build.object(main, ["-O1"]), *build.objects], wraps)
        except ToolFailedError as error:
            large = _TOO_LARGE.search("\n".join(error.lines))
            if large is None:
                raise
            # no fault of the code: this board is too small for it, another may not be
            detail = f"{int(large[2]):,} bytes more {large[1]} than {board.machine} has"
            return Result(check=check.name, target=check.target, verdict="left out", detail=detail)
        answer = build.answer(program, _SECONDS)
        said = "\n".join(f"{name} {bits}" for name, bits in _SELFTEST.findall(answer))
        found = selftest_faults(model, said)
        # a crash on a board is silence
        if "\nend\n" not in answer:
            found.append("the program ended before its last call")
        if found:
            return check.of(found, "golden solves differ")
        counted = build.counts()
        done = [
            _Call(
                name=name,
                status=int(status, 16),
                iterations=int(iterations, 16),
                stack=int(stack, 16),
                instructions=count,
            )
            for (name, status, iterations, stack), count in zip(
                _CALL.findall(answer), counted, strict=True
            )
        ]
        size = write_template(
            "online/size_main.c",
            folder,
            prefixes=names,
            controller=model.controller,
            filter=model.filter,
        )
        flash, data, bss = build.added(size)
        figures: list[Figures] = []
        for call in calls:
            # a call that refuses what it is given takes hardly any instructions
            own = [c for c in done if c.name == call["said"] and c.status < 3]
            if not own:
                continue
            bound = stack_bound(sorted(folder.glob("*.ci")), call["name"])
            painted = max(c.stack for c in own)
            # what was seen is deeper than what the call graph allows: one of the two figures is
            # wrong
            if bound is not None and painted > bound:
                found.append(
                    f"the stack of {call['said']} was {painted} bytes deep, "
                    f"the call graph allows {bound}"
                )
            counts = [c.instructions for c in own]
            figures.append(
                Figures(
                    flags=level,
                    of=call["said"],
                    instructions=(min(counts), sum(counts) / len(counts), max(counts)),
                    median=median(counts),
                    flash=flash,
                    data=data,
                    bss=bss,
                    stack_painted=painted,
                    stack_bound=bound,
                )
            )
        return check.of(found, f"self-tests: {promise(model)}{_worst(model, done)}", figures)

    needs = (board.compiler, board.emulator, GCC)
    check = ProofStep("golden solves", f"{board.core} {level}", needs, run)
    return check


def _worst(model: ExportedController, done: list[_Call]) -> str:
    """A text about the maximum cost of a call: its maximum number of iterations times the
    instructions of the most expensive one; empty without iterations.
    """
    caps = {
        "solve": 0 if model.controller is None else model.controller.iterations,
        "correct": 0 if model.filter is None else model.filter.iterations,
    }
    said = ""
    for name, cap in caps.items():
        # the dearest one, as iterations differ by what of the limits is active
        own = [c.instructions / c.iterations for c in done if c.name == name and c.iterations]
        if cap and own:
            each = int(max(own))
            said += f"; at most {cap} × {each:,} = {cap * each:,} instructions a {_NOUNS[name]}"
    return said


def _measured(model: ExportedController) -> list[dict[str, str]]:
    """The functions whose calls are measured, as variables of a C template: name, parameters,
    arguments.
    """
    found: list[dict[str, str]] = []

    def add(prefix: str, said: str, parameters: str, arguments: str, **more: str) -> None:
        call = {"type": "int", "iterations": "0", "name": f"{prefix}_{said}", "said": said}
        found.append(call | {"parameters": parameters, "arguments": arguments} | more)

    if model.controller is not None:
        p = model.controller.prefix
        both = f"{p}_t *c, const {p}_in_t *given, {p}_out_t *found"
        add(p, "solve", both, "c, given, found", iterations="found->iterations")
        add(p, "prepare", f"{p}_t *c", "c", type="void")
        add(p, "feedback", both, "c, given, found")
    if model.filter is not None:
        p = model.filter.prefix
        parameters = f"{p}_t *e, const {p}_measured_t *seen, {p}_out_t *found"
        more = {"iterations": "found->iterations"} if model.filter.is_window else {}
        add(p, "correct", parameters, "e, seen, found", **more)
        given = f", const {p}_in_t *given" if model.filter.inputs else ""
        add(p, "predict", f"{p}_t *e{given}", "e, given" if given else "e")
    return found
