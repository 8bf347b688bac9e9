"""Parses a board's results for the golden vectors, and finds the errors in them."""

from __future__ import annotations

import re
import zlib
from dataclasses import dataclass

from msnn.verification.builds.golden_run import differences
from msnn.verification.exported_c import ExportedC

# searched for: bootloaders and earlier answers may stand before it
_FRAME = re.compile(r"(model .*\n)end ([0-9a-f]{8})", re.DOTALL)
_PARTS = re.compile(r"model (\w+) (\w+)\n(.*\n)cycles (.*)\n", re.DOTALL)
END = re.compile(r"\nend [0-9a-f]{8}\s")
"""Matches the end of an answer."""


@dataclass(frozen=True, slots=True)
class Answer:
    """The errors found by a board, and the duration of a step."""

    findings: tuple[str, ...]
    cycles: tuple[int, float, int] | None
    """Minimum, mean and maximum; None without a counter."""


def read_answer(model: ExportedC, text: str) -> Answer:
    """Compares the lines of an answer with those of the interpreter."""
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
