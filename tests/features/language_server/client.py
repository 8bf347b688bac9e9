"""Speaks to `msnn lsp` as an editor does: a process, headers and JSON over its streams."""

from __future__ import annotations

import json
import queue
import subprocess
import sys
import threading
from collections.abc import Generator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

_START = "import sys; from msnn.cli.application import run; sys.exit(run(['lsp']))"
_PATIENCE = 120
"""Seconds until an answer is given up: no measure of anything."""
_END: dict[str, Any] = {}
"""Comes after the last message."""


class Client:
    """An editor with open texts, whose versions it counts."""

    def __init__(self) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-c", _START],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        )
        self._came: queue.Queue[dict[str, Any]] = queue.Queue()
        self._kept: list[dict[str, Any]] = []
        self._number = 0
        self._versions: dict[str, int] = {}
        self.can: dict[str, Any] = {}
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def request(self, method: str, params: Any) -> Any:
        """The result of a request; AssertionError where it is an error."""
        self._number += 1
        self._send({"id": self._number, "method": method, "params": params})
        answer = self._await(lambda message: message.get("id") == self._number)
        assert "error" not in answer, answer
        return answer["result"]

    def notify(self, method: str, params: Any) -> None:
        """Says something that has no answer."""
        self._send({"method": method, "params": params})

    def initialize(self, folder: Path) -> None:
        """The capabilities of the server, asked for as VS Code does; kept as `can`."""
        texts = {"codeAction": {}, "publishDiagnostics": {"relatedInformation": True}}
        capabilities = {"general": {"positionEncodings": ["utf-16"]}, "textDocument": texts}
        params = {"processId": None, "rootUri": folder.as_uri(), "capabilities": capabilities}
        result = self.request("initialize", params)
        self.notify("initialized", {})
        self.can = result["capabilities"]

    def open(self, path: Path, text: str) -> None:
        """Opens a text as that of a file."""
        self._versions[path.as_uri()] = 1
        document = {"uri": path.as_uri(), "languageId": "yaml", "version": 1, "text": text}
        self.notify("textDocument/didOpen", {"textDocument": document})

    def change(self, path: Path, text: str) -> None:
        """Replaces an open text."""
        self._versions[path.as_uri()] += 1
        document = {"uri": path.as_uri(), "version": self._versions[path.as_uri()]}
        params = {"textDocument": document, "contentChanges": [{"text": text}]}
        self.notify("textDocument/didChange", params)

    def close_text(self, path: Path) -> list[dict[str, Any]]:
        """Closes an open text; what is said of its file from then on, of no version."""
        self.notify("textDocument/didClose", {"textDocument": {"uri": path.as_uri()}})

        def is_of_it(message: dict[str, Any]) -> bool:
            params = message.get("params") or {}
            is_published = message.get("method") == "textDocument/publishDiagnostics"
            return is_published and (params["uri"], params.get("version")) == (path.as_uri(), None)

        return self._await(is_of_it)["params"]["diagnostics"]

    def diagnostics(self, path: Path) -> list[dict[str, Any]]:
        """What is said of the text as it was sent last, once it is."""
        version = self._versions[path.as_uri()]

        def is_of_it(message: dict[str, Any]) -> bool:
            params = message.get("params") or {}
            is_published = message.get("method") == "textDocument/publishDiagnostics"
            found = (params.get("uri"), params.get("version"))
            return is_published and found == (path.as_uri(), version)

        return self._await(is_of_it)["params"]["diagnostics"]

    def at(self, method: str, path: Path, line: int, character: int) -> Any:
        """What is said of a place: `hover`, `definition`, `completion`."""
        params = {
            "textDocument": {"uri": path.as_uri()},
            "position": {"line": line, "character": character},
        }
        return self.request(f"textDocument/{method}", params)

    def end(self) -> int:
        """The exit code after the editor has said that it ends."""
        self.request("shutdown", None)
        self.notify("exit", None)
        return self.process.wait(_PATIENCE)

    def close(self) -> None:
        """Ends the process, whatever it does."""
        self.process.kill()
        self.process.wait()
        self._reader.join()
        for stream in (self.process.stdin, self.process.stdout):
            assert stream is not None
            with suppress(BrokenPipeError):
                stream.close()

    def _send(self, message: dict[str, Any]) -> None:
        body = json.dumps({"jsonrpc": "2.0", **message}).encode()
        self.send_bytes(b"Content-Length: %d\r\n\r\n%s" % (len(body), body))

    def send_bytes(self, content: bytes) -> None:
        """Sends what may be no message."""
        assert self.process.stdin is not None
        self.process.stdin.write(content)
        self.process.stdin.flush()

    def _await(self, wanted: Any) -> dict[str, Any]:
        for message in self._kept:
            if wanted(message):
                self._kept.remove(message)
                return message
        while True:
            message = self._came.get(timeout=_PATIENCE)
            assert message is not _END, f"the server ended: {self.process.wait()}"
            if wanted(message):
                return message
            self._kept.append(message)

    def _read(self) -> None:
        stream = self.process.stdout
        assert stream is not None
        while header := stream.readline():
            length = int(header.split(b":")[1])
            while stream.readline().strip():
                pass
            self._came.put(json.loads(stream.read(length)))
        self._came.put(_END)


@contextmanager
def editor(folder: Path) -> Generator[Client]:
    """An editor whose server is initialised; the process is gone afterwards."""
    client = Client()
    try:
        client.initialize(folder)
        yield client
    finally:
        client.close()
