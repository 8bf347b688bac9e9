"""Writes ULog files by their public specification, without pyulog.

https://docs.px4.io/main/en/dev_log/ulog_file_format.html
"""

from __future__ import annotations

import struct
from collections.abc import Sequence

START = 5_000_000
"""Microseconds from boot at which the logs of this file begin."""


def header(start: int = START) -> bytes:
    return b"ULog\x01\x12\x35\x01" + struct.pack("<Q", start)


def message(kind: str, content: bytes) -> bytes:
    return struct.pack("<HB", len(content), ord(kind)) + content


def flags(appended: Sequence[int] = ()) -> bytes:
    offsets = [*appended, 0, 0, 0][:3]
    bits = bytes([bool(appended), *([0] * 7)])
    return message("B", bytes(8) + bits + struct.pack("<3Q", *offsets))


def topic_format(name: str, fields: str) -> bytes:
    """`fields` such as `uint64_t timestamp;float x;`."""
    return message("F", f"{name}:{fields}".encode())


def subscription(number: int, name: str, instance: int = 0) -> bytes:
    return message("A", struct.pack("<BH", instance, number) + name.encode())


def data(number: int, layout: str, *values: float | bytes) -> bytes:
    """One message; `layout` is that of `struct`, such as `Qf`."""
    return message("D", struct.pack(f"<H{layout}", number, *values))


def information(kind: str, key: str, value: bytes) -> bytes:
    """An information (`I`) or a parameter (`P`); the key is `int32_t SYS_ID`."""
    return message(kind, struct.pack("<B", len(key)) + key.encode() + value)


def dropout(milliseconds: int) -> bytes:
    return message("O", struct.pack("<H", milliseconds))
