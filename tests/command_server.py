"""Runs commands of msnn in processes forked from one that has imported what they import.

    python -m tests.command_server SOCKET [PACKAGE...]

More than half of what pages took of the processor were imports. What a process imports by
itself, and how fast it starts, is tested in `tests/cli` and `tests/light`.
"""

from __future__ import annotations

import gc
import importlib
import json
import os
import pkgutil
import select
import socket
import subprocess
import sys
import time
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
_ROOMS = ("spec_schema", "compiler", "backends", "msnn")
_OPTIONAL = (
    *("torch", "casadi", "onnx", "onnxruntime", "fmpy", "elftools", "matplotlib", "pandas"),
    *("polars", "openpyxl", "pyarrow", "scipy", "h5py", "asammdf", "rosbags", "nptdms"),
    *("pyulog", "tensorboard", "ziglang", "pygls", "lsprotocol", "ray", "optuna"),
)
"""Packages that a command imports by itself where it wants one: some do not survive a fork."""
_CLIENT = """\
#!{python} -IS
import json, os, socket, sys

with socket.socket(socket.AF_UNIX) as server:
    server.connect({address!r})
    asked = {{"words": sys.argv[1:], "folder": os.getcwd(), "environment": dict(os.environ)}}
    socket.send_fds(server, [b"."], [0, 1, 2])
    server.sendall(json.dumps(asked).encode() + b"\\n")
    answer = server.makefile()
    process = answer.readline()
    if told := os.environ.get("TELL_PROCESS"):
        with open(told, "w") as file:
            file.write(process)
    code = answer.read()
sys.exit(int(code or 70))
"""


@contextmanager
def commands(folder: Path, *packages: str) -> Generator[Path]:
    """A folder with a command `msnn`, whose processes are gone afterwards.

    Where TELL_PROCESS names a file, it gets the number of the process that a signal is for.
    Optional packages that are named are imported for all of them.
    """
    address = folder / "msnn.socket"
    client = folder / "msnn"
    client.write_text(_CLIENT.format(python=sys.executable, address=str(address)))
    client.chmod(0o755)
    server = subprocess.Popen(
        [sys.executable, "-m", __name__, str(address), *packages],
        cwd=ROOT,
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
    )
    while not address.exists():
        if server.poll() is not None:
            assert server.stderr is not None
            raise AssertionError(server.stderr.read().decode())
        time.sleep(0.02)
    try:
        yield folder
    finally:
        server.communicate()  # the end of its input is the end of it


def serve(address: Path, packages: Sequence[str]) -> None:
    """Answers until the standard input ends."""
    _load()
    for package in packages:
        importlib.import_module(package)
    gc.collect()
    gc.freeze()
    with socket.socket(socket.AF_UNIX) as listening:
        unnamed = address.with_suffix(".unnamed")
        listening.bind(str(unnamed))
        listening.listen()
        unnamed.rename(address)  # from now on somebody answers
        running: list[int] = []
        while True:
            ready, _, _ = select.select([listening, sys.stdin], [], [])
            running = [each for each in running if os.waitpid(each, os.WNOHANG) == (0, 0)]
            if sys.stdin in ready:
                break
            asking, _ = listening.accept()
            process = os.fork()
            if process == 0:
                listening.close()
                _answer(asking)
            running.append(process)
            asking.close()
    for process in running:
        os.waitpid(process, 0)


def _load() -> None:
    """Imports every module of ours that needs none of the optional packages."""
    for name in _OPTIONAL:
        sys.modules[name] = None  # pyright: ignore[reportArgumentType]
    for room in _ROOMS:
        package = importlib.import_module(room)
        for module in pkgutil.walk_packages(package.__path__, f"{room}.", lambda _: None):
            if not module.name.endswith("__main__"):
                try:
                    importlib.import_module(module.name)
                except ImportError:
                    continue
    for name in _OPTIONAL:
        del sys.modules[name]


def _answer(asking: socket.socket) -> None:
    """Runs one command in a process of its own, and says how it ended."""
    _, streams, _, _ = socket.recv_fds(asking, 1, 3)
    asked = json.loads(asking.makefile().readline())
    process = os.fork()
    if process == 0:
        asking.close()
        for number, stream in enumerate(streams):
            os.dup2(stream, number)
            os.close(stream)
        # the server's have a place in what they read, which a pipe has not
        sys.stdin = os.fdopen(0, closefd=False)
        sys.stdout = os.fdopen(1, "w", closefd=False)
        sys.stderr = os.fdopen(2, "w", 1, errors="backslashreplace", closefd=False)
        os.chdir(asked["folder"])
        os.environ.clear()
        os.environ.update(asked["environment"])
        # as in a process that starts anew: there are the packages that a page installs
        folders = os.environ.get("PYTHONPATH", "").split(os.pathsep)
        sys.path[:0] = [folder for folder in folders if folder and folder not in sys.path]
        sys.argv = ["msnn", *asked["words"]]
        from msnn.cli.main import main

        main()
    asking.sendall(f"{process}\n".encode())
    for stream in streams:
        os.close(stream)
    _, status = os.waitpid(process, 0)
    code = os.waitstatus_to_exitcode(status)
    asking.sendall(str(code if code >= 0 else 128 - code).encode())
    asking.close()
    os._exit(0)


if __name__ == "__main__":
    serve(Path(sys.argv[1]), sys.argv[2:])
