"""Runs a program in the RAM of a board with a debugger, and collects its output."""

from __future__ import annotations

from msnn.errors.targets.boards import refused_memory, silent
from msnn.verification.on_board.debugger import Debugger, RefusedMemoryError
from msnn.verification.on_board.ram_program import RamProgram
from spec_schema.diagnostics.diagnostic import SpecError

_SECONDS = 60.0
"""Maximum time between two output buffers; a replay takes at most a second on slow cores."""
_THUMB = 0x01000000
"""The Thumb bit of xPSR, which a Cortex-M requires."""


def run_in_ram(board: Debugger, program: RamProgram, link: str, begin: int) -> str:
    """Runs a program; SpecError if its memory cannot be written (E1322) or the core hangs
    (E1321).
    """
    places = program.symbols
    stops = [places[name] for name in ("hand_over", "finished", "trap")]
    text: list[bytes] = []
    try:
        board.load(begin, program.data)
        board.break_at(stops)
        board.set_register("sp", places["stack_top"])
        # a core halted in a fault handler would go on as one: the exception number is 0 now as well
        board.set_register("xpsr", _THUMB)
        board.set_register("pc", places["start"] & ~1)
        while (at := board.run(_SECONDS)) == places["hand_over"] & ~1:
            letters = board.read_word(places["handed_letters"])
            text.append(board.read(places["handed_text"], letters))
            # returns from the function that stands at the breakpoint: none of its code is needed
            board.set_register("pc", board.register("lr") & ~1)
        # not after a failure: a core that ended somewhere else is reset by its owner
        board.go_by(stops)
    except RefusedMemoryError as error:
        raise SpecError([refused_memory(link, error.address)]) from None
    except TimeoutError:
        raise SpecError([silent(link, f"the core ran {_SECONDS:g} s without a word")]) from None
    if at != places["finished"] & ~1:
        raise SpecError([silent(link, f"the core trapped: it stands at 0x{at:08x}")])
    return b"".join(text).decode("ascii", "replace")
