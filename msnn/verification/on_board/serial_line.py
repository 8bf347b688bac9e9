"""Requests the golden vectors from firmware on a serial line."""

from __future__ import annotations

import os
import re
import select
import sys
import time
import zlib
from dataclasses import dataclass

from msnn.errors.targets import silent, unreachable
from msnn.verification.exported_c import ExportedC
from msnn.verification.harness import differences
from msnn.verification.on_board.link import Serial, words
from spec_schema.diagnostics.diagnostic import SpecError

_ASKED = b"replay\n"
_SILENCE = 10.0
"""Maximum seconds without a byte; golden steps are sent as they are computed."""


def ask_serial(link: Serial) -> str:
    """Requests a replay from firmware on a serial line; returns the text of its answer.

    Raises SpecError if the line cannot be opened (E1320) or the answer does not end (E1321).
    """
    if sys.platform == "win32":
        raise SpecError([unreachable(words(link), "serial lines need a POSIX system")])
    try:
        # NOCTTY: a line must not become the terminal that sends Ctrl-C; NONBLOCK: open() would wait
        # for a modem
        line = os.open(link.port, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    except OSError as error:
        raise SpecError([unreachable(words(link), str(error))]) from None
    try:
        _set_raw(line, link)
        _send(line)
        return _received(line, link)
    except OSError as error:
        raise SpecError([unreachable(words(link), str(error))]) from None
    finally:
        os.close(line)


def _set_raw(line: int, link: Serial) -> None:
    """Sets eight bits, no parity, one stop bit, no flow control, raw mode."""
    import termios  # absent on Windows

    speed = getattr(termios, f"B{link.baud}", None)
    if speed is None:
        raise SpecError([unreachable(words(link), f"no line runs at {link.baud} baud")])
    try:
        controls = termios.tcgetattr(line)[6]
        # CLOCAL: a cable of three wires has no carrier to wait for
        flags = termios.CS8 | termios.CREAD | termios.CLOCAL
        termios.tcsetattr(line, termios.TCSANOW, [0, 0, flags, 0, speed, speed, controls])
        # what a board said before it was asked
        termios.tcflush(line, termios.TCIOFLUSH)
    except termios.error as error:
        raise SpecError([unreachable(words(link), f"no serial line ({error})")]) from None


def _send(line: int) -> None:
    left = _ASKED
    while left:
        select.select([], [line], [], _SILENCE)
        left = left[os.write(line, left) :]


def _received(line: int, link: Serial) -> str:
    text, end = "", time.monotonic() + _SILENCE
    # the end alone: an answer of many steps would be searched again for each part
    while END.search(text[-200:]) is None:
        ready, _, _ = select.select([line], [], [], max(0.0, end - time.monotonic()))
        part = os.read(line, 65536) if ready else b""
        if not part:
            said = f"{len(text)} letters, then silence" if text else "silence"
            raise SpecError([silent(words(link), f"{said} for {_SILENCE:g} s")])
        text += part.decode("ascii", "replace")
        end = time.monotonic() + _SILENCE
    return text


# searched for: bootloaders and earlier answers may stand before it
_FRAME = re.compile(r"(model .*\n)end ([0-9a-f]{8})", re.DOTALL)
_PARTS = re.compile(r"model (\w+) (\w+)\n(.*\n)cycles (.*)\n", re.DOTALL)
END = re.compile(r"\nend [0-9a-f]{8}\s")
"""Matches the end of an answer."""


@dataclass(frozen=True, slots=True)
class Answer:
    """The differences that a board has found, and the clock cycles of a step."""

    findings: tuple[str, ...]
    cycles: tuple[int, float, int] | None
    """Minimum, mean and maximum; None without a counter."""


def read_answer(model: ExportedC, text: str) -> Answer:
    """Compares the text that a board has sent with the expected bits; returns differences and
    cycles.
    """
    frame = _FRAME.search(text.replace("\r\n", "\n"))
    if frame is None:
        return Answer(("the answer has no beginning or no end",), None)
    # the firmware computes the same CRC-32 (IEEE 802.3) over what it sends
    if zlib.crc32(frame[1].encode()) != int(frame[2], 16):
        return Answer(("the answer was damaged on its way: its checksum differs",), None)
    parts = _PARTS.fullmatch(frame[1])
    if parts is None:
        return Answer(("the answer is that of another version of msnn",), None)
    prefix, identity, lines, cycles = parts.groups()
    # equal names of models say nothing about their weights
    if (prefix, identity) != (model.prefix, model.identity):
        other = f"the board runs `{prefix}` of the export {identity[:12]}: other firmware"
        return Answer((other,), None)
    return Answer(tuple(differences(model, lines)), _cycles(cycles))


def _cycles(text: str) -> tuple[int, float, int] | None:
    """Cycles per step: minimum, mean and maximum, from hexadecimal words."""
    if text.strip() == "none":
        return None
    least, high, low, most, count = (int(word, 16) for word in text.split())
    # a sum of 64 bits comes as two words
    return least, ((high << 32) | low) / max(count, 1), most
