"""Parses `--board` and `--ram`: the link to a board, and its usable memory."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

FORMS = "openocd:CFG, pyocd:ID, serial:PORT[@BAUD], gdb:HOST:PORT"
_BAUD = 115200
# VTOR wants a table of up to 128 words aligned to its size
_ALIGNED = 512
"""Alignment of the memory, because it begins with a vector table."""


@dataclass(frozen=True, slots=True)
class Gdb:
    """A link to a board: a gdb server that is already running at `host:port`."""

    host: str
    port: int


@dataclass(frozen=True, slots=True)
class OpenOcd:
    """A link to a board: OpenOCD, started with a configuration file."""

    config: str


@dataclass(frozen=True, slots=True)
class PyOcd:
    """A link to a board: pyOCD, started for the debug probe with this unique ID."""

    probe: str


@dataclass(frozen=True, slots=True)
class Serial:
    """A link to a board: a serial line to firmware that replays the golden vectors."""

    port: str
    baud: int


Link: TypeAlias = Gdb | OpenOcd | PyOcd | Serial


@dataclass(frozen=True, slots=True)
class Ram:
    """The memory of a board in which a test program may be placed: address and size in bytes."""

    address: int
    size: int


DEFAULT_RAM = Ram(0x20000000, 64 * 1024)
"""The usual RAM address of a Cortex-M."""


def link_of(text: str) -> Link | None:
    """Parses the option `--board`, such as `gdb:localhost:3333`; None if it is invalid."""
    kind, _, rest = text.partition(":")
    match kind:
        case "gdb":
            # from the right: an IPv6 address has colons of its own
            host, _, port = rest.rpartition(":")
            number = _number(port)
            fits = bool(host) and number is not None and number < 65536
            return Gdb(host, number) if fits and number is not None else None
        case "openocd":
            return OpenOcd(rest) if rest else None
        case "pyocd":
            return PyOcd(rest) if rest else None
        case "serial":
            # from the right: names of ports on Linux may have an `@` themselves
            port, at, baud = rest.rpartition("@")
            if not at:
                return Serial(rest, _BAUD) if rest else None
            number = _number(baud)
            return Serial(port, number) if port and number is not None else None
        case _:
            return None


def ram_of(text: str) -> Ram | None:
    """Parses the option `--ram`, `address:size`; None if it is invalid."""
    address, _, size = text.partition(":")
    try:
        ram = Ram(int(address, 0), int(size, 0))
    except ValueError:
        return None
    # within 32 bits
    fits = ram.size > 0 and 0 <= ram.address <= 2**32 - ram.size and ram.address % _ALIGNED == 0
    return ram if fits else None


def words(link: Link) -> str:
    """The text of a link as on the command line, such as `gdb:localhost:3333`."""
    match link:
        case Gdb(host, port):
            return f"gdb:{host}:{port}"
        case OpenOcd(config):
            return f"openocd:{config}"
        case PyOcd(probe):
            return f"pyocd:{probe}"
        case Serial(port, baud):
            return f"serial:{port}@{baud}"


def _number(text: str) -> int | None:
    return int(text) if text.isascii() and text.isdigit() and int(text) > 0 else None
