"""Reads and writes memory and registers of a halted ARM core, and runs it to a breakpoint."""

from __future__ import annotations

import re
import struct
from collections.abc import Iterable, Iterator

from msnn.verification.on_board.packets import Packets, StubFailedError

_ELEMENT = re.compile(r"<(reg|xi:include)\s([^>]*)>")
_ATTRIBUTE = re.compile(r'(\w+)="([^"]*)"')
_CHUNK = 256
"""Bytes of memory per packet: servers accept at least twice as many characters."""


class RefusedMemoryError(Exception):
    """Memory at an address cannot be read or written."""

    def __init__(self, address: int) -> None:
        super().__init__(f"0x{address:08x}")
        self.address = address


class Debugger:
    """A core behind a gdb server."""

    def __init__(self, packets: Packets) -> None:
        self._packets = packets
        # before anything else: servers hand out their description only to a gdb that reads it
        packets.ask(b"qSupported:xmlRegisters=arm")
        self._registers = dict(self._numbered())
        # Cortex-A and -R have cpsr
        if not {"sp", "lr", "pc", "xpsr"} <= set(self._registers):
            raise StubFailedError("the core is no ARM Cortex-M")

    def monitor(self, command: str) -> None:
        """Sends a command to the server itself."""
        # the text of the command in hexadecimal digits
        self._packets.ask(b"qRcmd," + command.encode().hex().encode())

    def read(self, address: int, size: int) -> bytes:
        """Reads bytes of memory."""
        parts: list[bytes] = []
        for at in range(address, address + size, _CHUNK):
            count = min(_CHUNK, address + size - at)
            answer = self._packets.ask(f"m{at:x},{count:x}".encode())
            try:
                part = bytes.fromhex(answer.decode("ascii", "replace"))
            except ValueError:
                # "E01" has an odd number of digits, so that a refusal ends here as well
                part = b""
            if len(part) != count:
                raise RefusedMemoryError(at)
            parts.append(part)
        return b"".join(parts)

    def read_word(self, address: int) -> int:
        """Reads a 32-bit word of memory."""
        # registers and memory of Cortex-M are little-endian, but for rare parts
        return int(struct.unpack("<I", self.read(address, 4))[0])

    def load(self, address: int, data: bytes) -> None:
        """Writes bytes to memory and verifies them."""
        for at in range(0, len(data), _CHUNK):
            part = data[at : at + _CHUNK]
            command = f"M{address + at:x},{len(part):x}:{part.hex()}"
            if self._packets.ask(command.encode()) != b"OK":
                raise RefusedMemoryError(address + at)
        # an OK is no proof that the bytes arrived: addresses of flash are answered alike
        there = self.read(address, len(data))
        if there != data:
            differs = next(i for i, (a, b) in enumerate(zip(there, data, strict=True)) if a != b)
            raise RefusedMemoryError(address + differs)

    def register(self, name: str) -> int:
        """Reads a 32-bit register."""
        answer = self._packets.ask(b"p%x" % self._registers[name])
        try:
            return int(struct.unpack("<I", bytes.fromhex(answer.decode("ascii")))[0])
        except (ValueError, struct.error):
            raise StubFailedError(f"it does not tell the register {name}") from None

    def set_register(self, name: str, value: int) -> None:
        """Sets a register of 32 bits."""
        number = self._registers[name]
        if (
            self._packets.ask(b"P%x=%s" % (number, struct.pack("<I", value).hex().encode()))
            != b"OK"
        ):
            raise StubFailedError(f"it does not set the register {name}")

    def break_at(self, addresses: Iterable[int]) -> None:
        """Sets breakpoints at these addresses of Thumb code in RAM."""
        for address in addresses:
            # the lowest bit of a function's address says Thumb, the instruction is at the even one;
            # Z0 puts a breakpoint of 2 bytes in its place
            if self._packets.ask(f"Z0,{address & ~1:x},2".encode()) != b"OK":
                raise StubFailedError("it sets no breakpoints")

    def go_by(self, addresses: Iterable[int]) -> None:
        """Removes the breakpoints at these addresses."""
        for address in addresses:
            self._packets.ask(f"z0,{address & ~1:x},2".encode())

    def run(self, seconds: float) -> int:
        """Runs the core until it stops; returns the program counter. Raises TimeoutError."""
        try:
            answer = self._packets.ask(b"c", seconds)
        except TimeoutError:
            # a core that still runs would not answer the next packet
            self._packets.interrupt()
            self._packets.wait(10.0)
            raise
        # T and S tell a stop; W and X, the end of a process, are none that a core has
        if answer[:1] not in (b"T", b"S"):
            said = answer.decode("ascii", "replace")
            raise StubFailedError(f"it answered `{said}` where the core should run")
        return self.register("pc") & ~1

    def _numbered(self) -> Iterator[tuple[str, int]]:
        """Names and numbers of registers, from the target description of the server."""
        number = 0
        for found in self._elements("target.xml", 0):
            # numbers count on from the last one that is given (gdb manual, Target Description
            # Format)
            number = int(found.get("regnum", number))
            yield found.get("name", "").lower(), number
            number += 1

    def _elements(self, document: str, depth: int) -> Iterator[dict[str, str]]:
        for kind, inner in _ELEMENT.findall(self._document(document)):
            attributes = dict(_ATTRIBUTE.findall(inner))
            if kind == "reg":
                yield attributes
            # the target's file includes one file for each feature; one that includes itself ends
            # here
            elif depth == 0:
                yield from self._elements(attributes.get("href", ""), 1)

    def _document(self, name: str) -> str:
        text = b""
        while True:
            request = f"qXfer:features:read:{name}:{len(text):x},400"
            part = self._packets.ask(request.encode())
            text += part[1:]
            # "m" promises more, "l" is the last part (gdb manual, qXfer)
            if part[:1] != b"m":
                return text.decode("utf-8", "replace")
