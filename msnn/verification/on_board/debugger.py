"""Controls a halted ARM core through a gdb server: memory, registers, breakpoints."""

from __future__ import annotations

import os
import re
import socket
import struct
import subprocess
import tempfile
import time
from collections.abc import Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import IO

from msnn.errors.targets import unreachable
from msnn.verification.on_board.link import Gdb, OpenOcd, PyOcd, words
from spec_schema.diagnostics.diagnostic import SpecError

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
    """An ARM core that is controlled through a gdb server: memory, registers, breakpoints."""

    def __init__(self, packets: Packets) -> None:
        self._packets = packets
        # before anything else: servers hand out their description only to a gdb that reads it
        packets.ask(b"qSupported:xmlRegisters=arm")
        self._registers = dict(self._numbered())
        # Cortex-A and -R have cpsr
        if not {"sp", "lr", "pc", "xpsr"} <= set(self._registers):
            raise StubFailedError("the core is no ARM Cortex-M")

    def monitor(self, command: str) -> None:
        """Sends a command to the gdb server itself, such as `reset halt`."""
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


_PACKET = re.compile(rb"\$([^#]*)#([0-9a-fA-F]{2})", re.DOTALL)
_TRIES = 3


class StubFailedError(Exception):
    """A gdb server ended, did not respond or violated the protocol."""


class Packets:
    """A connection whose packets have a checksum and are acknowledged.

    The protocol is described in Appendix E of the gdb manual.
    """

    def __init__(self, connection: socket.socket) -> None:
        self._connection = connection
        self._received = b""

    def ask(self, command: bytes, seconds: float = 10.0) -> bytes:
        """Sends a command and returns the reply, without console output of the server."""
        self._send(command)
        end = time.monotonic() + seconds
        while (answer := self._packet(end)) and answer[:1] == b"O" and answer != b"OK":
            pass  # text for the console of gdb
        return answer

    def interrupt(self) -> None:
        """Interrupts a running core with a single byte instead of a packet."""
        self._connection.sendall(b"\x03")

    def wait(self, seconds: float) -> bytes:
        """Waits for the reply to the previous command, for at most `seconds`."""
        return self._packet(time.monotonic() + seconds)

    def _send(self, command: bytes) -> None:
        packet = b"$%s#%02x" % (command, sum(command) % 256)
        try:
            self._connection.sendall(packet)
        except OSError as error:
            raise StubFailedError(f"the connection is lost ({error})") from None

    def _packet(self, end: float) -> bytes:
        # a damaged packet is asked for again by a minus
        for _ in range(_TRIES):
            # searched for: acknowledgements of what was sent stand before it
            while (found := _PACKET.search(self._received)) is None:
                self._receive(end)
            self._received = self._received[found.end() :]
            if sum(found[1]) % 256 == int(found[2], 16):
                self._connection.sendall(b"+")
                return _expanded(found[1])
            self._connection.sendall(b"-")
        raise StubFailedError("its packets arrive damaged")

    def _receive(self, end: float) -> None:
        left = end - time.monotonic()
        if left <= 0:
            raise TimeoutError
        self._connection.settimeout(left)
        try:
            part = self._connection.recv(65536)
        except TimeoutError:
            raise
        except OSError as error:
            raise StubFailedError(f"the connection is lost ({error})") from None
        if not part:
            raise StubFailedError("the gdb server closed the connection")
        self._received += part


def _expanded(text: bytes) -> bytes:
    """Expands the two escapes of a packet: `*` repeats a byte, `}` escapes one."""
    result = bytearray()
    letters = iter(text)
    for letter in letters:
        if letter == ord("}"):
            # of `#`, `$`, `}` and `*`, which mean something between packets
            result.append(next(letters, 0) ^ 0x20)
        elif letter == ord("*") and result:
            # the count is printable: a blank (32) for three more
            result += result[-1:] * max(0, next(letters, 29) - 29)
        else:
            result.append(letter)
    return bytes(result)


_PYOCD_PROJECT = "PYOCD_PROJECT_DIR"
_START_SECONDS = 20.0
"""Seconds until a probe finds its board."""


@contextmanager
def gdb_server(link: Gdb | OpenOcd | PyOcd) -> Generator[socket.socket]:
    """A connection to the server; a started server ends with it. Raises SpecError (E1320)."""
    match link:
        case Gdb(host, port):
            try:
                connection = _connection(host, port)
            except OSError as error:
                raise SpecError([unreachable(words(link), str(error))]) from None
            with connection:
                yield connection
        case OpenOcd(config):
            port = _free_port()
            quiet = ["-c", "tcl_port disabled", "-c", "telnet_port disabled"]
            command = ["openocd", *quiet, "-c", f"gdb_port {port}", "-f", config]
            with _started(words(link), command, port) as connection:
                yield connection
        case PyOcd(probe):
            port = _free_port()
            command = ["pyocd", "gdbserver", "--uid", probe, "--port", str(port)]
            # pyOCD runs a `pyocd_user.py` of the folder in which it is started, unless the user
            # has named another one for it
            with tempfile.TemporaryDirectory(prefix="msnn-pyocd-") as empty:
                project = os.environ.get(_PYOCD_PROJECT) or empty
                with _started(words(link), command, port, {_PYOCD_PROJECT: project}) as connection:
                    yield connection


def _connection(host: str, port: int) -> socket.socket:
    connection = socket.create_connection((host, port), timeout=_START_SECONDS)
    # an acknowledgement and a command follow each other: neither shall wait for the other's
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return connection


def _free_port() -> int:
    # closed again: another process may take it before the server does, which then says so and ends
    with socket.socket() as any:
        any.bind(("127.0.0.1", 0))
        return int(any.getsockname()[1])


@contextmanager
def _started(
    link: str, command: Sequence[str], port: int, environment: Mapping[str, str] | None = None
) -> Generator[socket.socket]:
    with (
        # a file, no pipe: a server that talks much would stop when nobody reads
        tempfile.TemporaryFile() as output,
        subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            env={**os.environ, **(environment or {})},
        ) as process,
    ):
        try:
            connection = _connected(link, process, port, output)
            with connection:
                yield connection
        finally:
            # the debug interface is released on SIGTERM; a killed server leaves probes claimed
            process.terminate()
            try:
                process.wait(5.0)
            except subprocess.TimeoutExpired:
                process.kill()


def _connected(
    link: str, process: subprocess.Popen[bytes], port: int, output: IO[bytes]
) -> socket.socket:
    end = time.monotonic() + _START_SECONDS
    while process.poll() is None and time.monotonic() < end:
        try:
            return _connection("127.0.0.1", port)
        except OSError:
            time.sleep(0.05)
    reason = "its gdb server has ended" if process.poll() is not None else "it is silent"
    output.seek(0)
    said = output.read().decode("utf-8", "replace").strip().splitlines()[-5:]
    raise SpecError([unreachable(link, reason, said)])
