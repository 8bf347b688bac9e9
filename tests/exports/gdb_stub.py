"""Drives a program in QEMU through its gdb stub: calls functions, reads and writes memory."""

from __future__ import annotations

import socket
import struct
import subprocess
import time
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

_STACK, _RETURN, _THUMB = 0x2000_8000, 0x2000_9000, 0x0100_0000
_SP, _LR, _PC, _XPSR = 13, 14, 15, 25
_PATIENCE = 60.0
"""Seconds: a machine that is busy starts QEMU slowly."""


class CortexM:
    """A Cortex-M4 that stands still between calls."""

    def __init__(self, connection: socket.socket) -> None:
        self._connection = connection
        # QEMU lets only those write registers who have asked how it numbers them
        self._ask("qXfer:features:read:target.xml:0,ffb")
        self._ask(f"Z0,{_RETURN:x},2")

    def call(self, function: int) -> None:
        """Runs a function of no arguments until it returns."""
        registers = {_SP: _STACK, _LR: _RETURN | 1, _PC: function & ~1, _XPSR: _THUMB}
        for number, value in registers.items():
            assert self._ask(f"P{number:x}={struct.pack('<I', value).hex()}") == "OK"
        assert self._ask("c").startswith(("T05", "S05"))

    def read_float(self, address: int) -> float:
        return struct.unpack("<f", bytes.fromhex(self._ask(f"m{address:x},4")))[0]

    def read_word(self, address: int) -> int:
        return struct.unpack("<I", bytes.fromhex(self._ask(f"m{address:x},4")))[0]

    def write_float(self, address: int, value: float) -> None:
        assert self._ask(f"M{address:x},4:{struct.pack('<f', value).hex()}") == "OK"

    def _ask(self, command: str) -> str:
        packet = f"${command}#{sum(command.encode()) % 256:02x}"
        self._connection.sendall(packet.encode())
        received = b""
        while b"#" not in received or len(received.rpartition(b"#")[2]) < 2:
            part = self._connection.recv(4096)
            assert part, "QEMU has ended"
            received += part
        self._connection.sendall(b"+")
        return received.rpartition(b"$")[2].partition(b"#")[0].decode()


@contextmanager
def cortex_m4(program: Path) -> Generator[CortexM]:
    """The program in the memory of a board that has not begun to run."""
    place = program.with_suffix(".gdb")
    stub = ["-chardev", f"socket,path={place},server=on,wait=off,id=gdb", "-gdb", "chardev:gdb"]
    board = ["-M", "mps2-an386", "-display", "none", "-monitor", "none", "-serial", "none"]
    command = ["qemu-system-arm", *board, "-S", *stub, "-kernel", str(program)]
    with subprocess.Popen(command) as process, socket.socket(socket.AF_UNIX) as connection:
        try:
            connection.settimeout(_PATIENCE)
            _connect(connection, place, process)
            yield CortexM(connection)
        finally:
            process.kill()


def _connect(connection: socket.socket, place: Path, process: subprocess.Popen[bytes]) -> None:
    end = time.monotonic() + _PATIENCE
    while True:
        try:
            connection.connect(str(place))
        except OSError:
            assert process.poll() is None, "QEMU has ended"
            assert time.monotonic() < end, "QEMU does not answer"
            time.sleep(0.05)
        else:
            return
