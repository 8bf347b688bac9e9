"""Starts OpenOCD or pyOCD if requested, and connects to the gdb server of a board."""

from __future__ import annotations

import os
import socket
import subprocess
import tempfile
import time
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from typing import IO

from msnn.errors.targets.boards import unreachable
from msnn.verification.on_board.link import Gdb, OpenOcd, PyOcd, words
from spec_schema.diagnostics.diagnostic import SpecError

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
