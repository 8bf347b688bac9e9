"""Implements the gdb remote serial protocol over a socket: one reply per packet."""

from __future__ import annotations

import re
import socket
import time

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
        """The reply to a command, without console output of the server."""
        self._send(command)
        end = time.monotonic() + seconds
        while (answer := self._packet(end)) and answer[:1] == b"O" and answer != b"OK":
            pass  # text for the console of gdb
        return answer

    def interrupt(self) -> None:
        """Interrupts a running core with a single byte instead of a packet."""
        self._connection.sendall(b"\x03")

    def wait(self, seconds: float) -> bytes:
        """The reply to the previous command."""
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
