"""Measures how long `msnn lsp` takes to answer on a spec of 2,000 equations, while it is edited.

    python benchmarks/language_server/answers.py [--write]

Each round changes the text and asks at once, so that a check of the text is due or running
beside every answer. The clock is that of the editor: a request sent, its answer read. Processor
time is the server's, from the change of the text to the answer: on a machine that does nothing else
the clock shows little more. `--write` writes RESULTS.md.
"""

from __future__ import annotations

import argparse
import os
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[2]))

from tests.features.language_server.client import Client, editor

EQUATIONS = 2000
ROUNDS = 30
LIMIT = 0.1
"""Seconds that an answer may take."""

_TEXT = """\
# Answers of the language server

Written by `python benchmarks/language_server/answers.py --write`: a spec of {equations:,} equations
({characters:,} characters), {rounds} rounds; each changes the text and asks at once. Processor time
is the server's from the change to the answer; the clock is the editor's, from the request to the
answer, on a machine with {cores} cores of which {load:.1f} processes were waiting or running
(its load over the minute at the end) while this ran with niceness {nice}.

| answer, ms | processor, median | processor, most | clock, median | clock, most |
|---|---|---|---|---|
{rows}

| diagnostics, s | processor | clock |
|---|---|---|
| first, with the start of both processes | {first.processor:.2f} | {first.clock:.2f} |
| after a change, with the pause before | {later.processor:.2f} | {later.clock:.2f} |
"""


@dataclass(frozen=True)
class Taken:
    """Seconds of one answer: by the editor's clock, and of CPU time."""

    clock: float
    processor: float


def main() -> int:
    """Prints the tables; 1 where half of the answers to a request take more than they may."""
    parser = argparse.ArgumentParser(description="Measures answers of the language server.")
    parser.add_argument("--write", action="store_true")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder, editor(Path(folder)) as client:
        path, text = Path(folder) / "large.msnn.yaml", large_spec()
        first = _taken(_both, client, lambda: (client.open(path, text), _none(client, path)))
        answers = _rounds(client, path, text)
        client.diagnostics(path)
        later = _taken(
            _both, client, lambda: (client.change(path, text + "\n"), _none(client, path))
        )
    page = _TEXT.format(
        equations=EQUATIONS,
        characters=len(text),
        rounds=ROUNDS,
        cores=os.cpu_count(),
        load=os.getloadavg()[0],
        nice=os.nice(0),
        rows="\n".join(_row(name, taken) for name, taken in answers.items()),
        first=first,
        later=later,
    )
    print(page)
    if given.write:
        Path(__file__).with_name("RESULTS.md").write_text(page, encoding="utf-8")
    medians = (statistics.median(t.processor for t in taken) for taken in answers.values())
    return int(any(median > LIMIT for median in medians))


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


def _rounds(client: Client, path: Path, text: str) -> dict[str, list[Taken]]:
    lines = text.split("\n")
    last = len(lines) - 4  # the formula of the last equation
    asked: dict[str, Callable[[], Any]] = {
        "hover": lambda: client.at("hover", path, last, 12),
        "definition": lambda: client.at("definition", path, last, 12),
        "completion in a formula": lambda: client.at("completion", path, last, 11),
        "completion of a key": lambda: client.at("completion", path, last, 5),
        "outline": lambda: client.request(
            "textDocument/documentSymbol", {"textDocument": {"uri": path.as_uri()}}
        ),
    }
    taken: dict[str, list[Taken]] = {name: [] for name in asked}
    for number in range(ROUNDS):
        for name, ask in asked.items():
            lines[last] = f"    expr: e1 - k{number % 20} * x"
            begun = _processor([client.process.pid])
            client.change(path, "\n".join(lines))
            clock = time.perf_counter()
            assert ask() is not None
            clock = time.perf_counter() - clock
            taken[name].append(Taken(clock, _processor([client.process.pid]) - begun))
    return taken


def _none(client: Client, path: Path) -> None:
    """Waits for the diagnostics of a text without errors."""
    assert client.diagnostics(path) == []


def _taken(
    processes: Callable[[Client], list[int]], client: Client, does: Callable[[], object]
) -> Taken:
    processor, clock = _processor(processes(client)), time.perf_counter()
    does()
    clock = time.perf_counter() - clock
    return Taken(clock, _processor(processes(client)) - processor)


def _both(client: Client) -> list[int]:
    """The process numbers of the server and of the processes that it started."""
    server = client.process.pid
    threads = Path(f"/proc/{server}/task").iterdir()
    begun = [p for t in threads for p in (t / "children").read_text(encoding="utf-8").split()]
    return [server, *map(int, begun)]


def _processor(processes: list[int]) -> float:
    """CPU seconds of all threads of these processes."""
    spent = 0
    for process in processes:
        for thread in Path(f"/proc/{process}/task").iterdir():
            spent += int((thread / "schedstat").read_text(encoding="utf-8").split()[0])
    return 1e-9 * spent


def _row(name: str, taken: list[Taken]) -> str:
    clock, processor = [t.clock for t in taken], [t.processor for t in taken]
    figures = (statistics.median(processor), max(processor), statistics.median(clock), max(clock))
    return f"| {name} | " + " | ".join(f"{1e3 * figure:.0f}" for figure in figures) + " |"


if __name__ == "__main__":
    sys.exit(main())
