"""Sends requests of the benchmark to a tool in a process of its own."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from environments import peer_python

_CONTENDERS = Path(__file__).parent / "contenders"


@dataclass(frozen=True, slots=True)
class Tool:
    """A tool that is measured: its name and how it is started."""

    name: str
    script: str
    arguments: tuple[str, ...] = ()
    environment: str | None = None
    """The peer whose interpreter runs it; None for the one that runs the benchmark."""
    epochs_a_round: int = 1

    def command(self) -> list[str]:
        python = sys.executable if self.environment is None else str(peer_python(self.environment))
        return [python, str(_CONTENDERS / self.script), *self.arguments]


TOOLS = {
    tool.name: tool
    for tool in (
        Tool("nnodely 1.5.4", "nnodely_peer.py", environment="nnodely"),
        Tool("msnn native", "msnn_engine.py", ("native",), epochs_a_round=40),
        Tool("msnn kernel", "msnn_kernel.py", epochs_a_round=40),
        Tool("msnn torch", "msnn_engine.py", ("torch",)),
        Tool("JAX jit + scan", "jax_scan.py", environment="jax", epochs_a_round=5),
        Tool("torch by hand", "torch_by_hand.py", ("eager",)),
        Tool("torch.compile by hand", "torch_by_hand.py", ("compiled",)),
        Tool("NeuroMANCER 1.5.6", "neuromancer_peer.py", environment="neuromancer"),
    )
}
PEER, NATIVE, KERNEL, TORCH, JAX, _, _, NEUROMANCER = TOOLS


class Worker:
    """A running process of one tool with one workload."""

    def __init__(self, tool: Tool, settings: dict[str, Any], errors: Path) -> None:
        self.tool = tool
        self._errors = errors
        with errors.open("w") as stream:
            self._process = subprocess.Popen(
                tool.command(),
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=stream,
                text=True,
            )
        self.build_seconds: float | None = self._ask(settings)["build_seconds"]

    def epochs(self, count: int, *, fixed: bool = False) -> tuple[float, list[float]]:
        """Trains `count` epochs; returns seconds per epoch, and the loss of each as the tool
        reports it.
        """
        answer = self._ask({"do": "epochs", "count": count, "fixed": fixed})
        return answer["seconds"] / count, answer["losses"]

    def reset(self) -> None:
        self._ask({"do": "reset"})

    def gradient(self, weights: dict[str, list[float]]) -> dict[str, list[float]]:
        return self._ask({"do": "gradient", "weights": weights})

    def close(self) -> None:
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait(timeout=30)

    def _ask(self, request: dict[str, Any]) -> dict[str, Any]:
        stdin, stdout = self._process.stdin, self._process.stdout
        assert stdin is not None
        assert stdout is not None
        stdin.write(json.dumps(request) + "\n")
        stdin.flush()
        for line in stdout:
            if line.startswith("{"):  # not what a tool prints when it is imported
                return json.loads(line)
        message = f"{self.tool.name} ended: {self._errors.read_text()[-2000:]}"
        raise RuntimeError(message)


def open_workers(tools: Sequence[str], settings: dict[str, Any], folder: Path) -> dict[str, Worker]:
    """Starts a process for each tool, all with the same workload."""
    return {name: Worker(TOOLS[name], settings, folder / f"{name}.err") for name in tools}
