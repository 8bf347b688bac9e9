"""Replays the golden vectors on the board behind a link."""

from __future__ import annotations

import socket
from pathlib import Path

from msnn.errors.targets import silent, unknown_core
from msnn.verification.exported_c import ExportedC
from msnn.verification.on_board.debugger import (
    Debugger,
    Packets,
    RefusedMemoryError,
    StubFailedError,
    gdb_server,
)
from msnn.verification.on_board.link import Gdb, Link, OpenOcd, PyOcd, Ram, Serial, words
from msnn.verification.on_board.ram_program import (
    CPUID,
    FPU_FEATURES,
    Core,
    build_ram_program,
    core_of,
    run_in_ram,
)
from msnn.verification.on_board.serial_line import Answer, ask_serial, read_answer
from msnn.verification.proof_step import ARM_GCC, OPENOCD, PYOCD, ProofStep, Result, Tool
from spec_schema.diagnostics.diagnostic import SpecError

_LEVEL = "-O2"


def board_check(link: Link, model: ExportedC, ram: Ram) -> ProofStep:
    """A check that replays golden vectors on a physical board; raises SpecError (E1320-E1324)
    without answer.
    """

    def run(folder: Path) -> Result:
        match link:
            case Serial():
                place, answer = link.port, read_answer(model, ask_serial(link))
            case _:
                core, answer = _debugged(link, model, ram, folder)
                place = f"{core.name} {_LEVEL}"
        return _result(step, place, model, answer)

    step = ProofStep("on the board", words(link), _needs(link), run)
    return step


def _debugged(
    link: Gdb | OpenOcd | PyOcd, model: ExportedC, ram: Ram, folder: Path
) -> tuple[Core, Answer]:
    with gdb_server(link) as connection:
        try:
            return _run(connection, link, model, ram, folder)
        except StubFailedError as error:
            raise SpecError([silent(words(link), str(error))]) from None
        except TimeoutError:
            raise SpecError([silent(words(link), "the gdb server does not answer")]) from None


def _run(
    connection: socket.socket,
    link: Gdb | OpenOcd | PyOcd,
    model: ExportedC,
    ram: Ram,
    folder: Path,
) -> tuple[Core, Answer]:
    board = Debugger(Packets(connection))
    if not isinstance(link, Gdb):
        # a server that runs already may serve a session of the user's, whose board is not reset
        board.monitor("reset halt")
    core = _core(board, link)
    program = build_ram_program(model, core, _LEVEL, ram, folder)
    return core, read_answer(model, run_in_ram(board, program, words(link), ram.address))


def _core(board: Debugger, link: Link) -> Core:
    try:
        identity = board.read_word(CPUID)
        # by its registers: who calls need not say which core is behind the probe
        core = core_of(identity, board.read_word(FPU_FEATURES))
    except RefusedMemoryError:
        raise SpecError([unknown_core(words(link), None)]) from None
    if core is None:
        raise SpecError([unknown_core(words(link), identity)])
    return core


def _result(step: ProofStep, place: str, model: ExportedC, answer: Answer) -> Result:
    if answer.findings:
        return step.of(answer.findings, f"{place}: golden steps differ")
    promise = "0 bits differ" if model.exact else "within the tolerance"
    took = "no cycle counter"
    if answer.cycles is not None:
        least, mean, most = answer.cycles
        took = f"{least} to {most} cycles a step, {mean:.1f} in the mean"
    detail = f"{place}: {len(model.expected)} golden steps, {promise}; {took}"
    return step.of([], detail, cycles=answer.cycles)


def _needs(link: Link) -> tuple[Tool, ...]:
    match link:
        case Serial():
            return ()
        case Gdb():
            return (ARM_GCC,)
        case OpenOcd():
            return (ARM_GCC, OPENOCD)
        case PyOcd():
            return (ARM_GCC, PYOCD)
