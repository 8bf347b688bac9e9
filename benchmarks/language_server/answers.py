"""Measures how long `msnn lsp` takes to answer on a spec of 2,000 equations, while it is edited.

    python benchmarks/language_server/answers.py

Each round changes the text and asks at once, so that a check of the text is due or running
beside every answer. Times are those of the editor: a request sent, its answer read.
"""

from __future__ import annotations

import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[2]))

from tests.language_server.client import Client, editor

EQUATIONS = 2000
ROUNDS = 30
LIMIT = 0.1
"""Seconds that an answer may take."""


def main() -> int:
    """Prints a table; 1 where an answer of half of the rounds takes longer than it may."""
    with tempfile.TemporaryDirectory() as folder, editor(Path(folder)) as client:
        path = Path(folder) / "large.msnn.yaml"
        text = large_spec()
        began = time.perf_counter()
        client.open(path, text)
        found = client.diagnostics(path)
        print(f"{EQUATIONS} equations, {len(text):,} characters, {len(found)} diagnostics")
        print(f"first diagnostics after {time.perf_counter() - began:.2f} s\n")
        taken = _rounds(client, path, text)
        began = time.perf_counter()
        client.change(path, text + "\n")
        client.diagnostics(path)
        print(f"\ndiagnostics after a change: {time.perf_counter() - began:.2f} s")
    return int(any(statistics.median(times) > LIMIT for times in taken.values()))


def large_spec() -> str:
    """Forty chains of fifty equations over one input and twenty parameters."""
    parameters = [f"  k{i}: {{init: 0.{i + 1}, doc: gain {i}}}" for i in range(20)]
    equations: list[str] = []
    for i in range(EQUATIONS):
        before = f"e{i - 1}" if i % 50 else f"{i} * F"
        formula = f"{before} - k{i % 20} * x[t-{i % 9}]"
        equations += [f"  e{i}:", f"    expr: {formula}", f"    doc: part {i} of the force"]
    total = " + ".join(f"e{i}" for i in range(49, EQUATIONS, 50))
    head = ["msnn: 1", "name: large", "sample_time: 10 ms", "inputs:", "  F: {}", "  x: {}"]
    lines = [*head, "parameters:", *parameters, "equations:", *equations, "outputs:"]
    return "\n".join([*lines, f"  total: {total}", ""])


def _rounds(client: Client, path: Path, text: str) -> dict[str, list[float]]:
    lines = text.split("\n")
    last = len(lines) - 4  # the formula of the last equation
    asked: dict[str, Callable[[], Any]] = {
        "hover": lambda: client.at("hover", path, last, 12),
        "definition": lambda: client.at("definition", path, last, 12),
        "completion in a formula": lambda: client.at("completion", path, last, 11),
        "completion of a key": lambda: client.at("completion", path, last, 5),
        "documentSymbol": lambda: client.request(
            "textDocument/documentSymbol", {"textDocument": {"uri": path.as_uri()}}
        ),
    }
    taken: dict[str, list[float]] = {name: [] for name in asked}
    for number in range(ROUNDS):
        for name, ask in asked.items():
            lines[last] = f"    expr: e1 - k{number % 20} * x"
            client.change(path, "\n".join(lines))
            began = time.perf_counter()
            assert ask() is not None
            taken[name].append(time.perf_counter() - began)
    print(f"{'answer':26}{'first':>10}{'median':>10}{'worst later':>14}")
    for name, (first, *later) in taken.items():
        median, worst = statistics.median(later), max(later)
        print(f"{name:26}{1e3 * first:7.1f} ms{1e3 * median:7.1f} ms{1e3 * worst:11.1f} ms")
    return taken


if __name__ == "__main__":
    sys.exit(main())
