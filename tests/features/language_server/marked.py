"""Takes a place out of a text in which `|` marks it."""

from __future__ import annotations

from pathlib import Path

from msnn.features.language_server.knowledge import Knowledge, examine
from msnn.features.language_server.positions import Position
from msnn.features.language_server.view import View
from spec_schema.diagnostics.source import SourceText

PLANT = """\
msnn: 1
name: plant
sample_time: 10 ms
dims: {wheel: [front, rear]}
inputs:
  force: {unit: N, dims: wheel, doc: of the actuator}
  speed: {unit: m/s}
parameters:
  gain: {init: 2 1/N, doc: how much}
functions:
  twice: {args: [a, b], expr: 2 * a + b}
layers:
  past: {fir: {window: 30 ms}}
equations:
  push: gain * sum(force[t-3:t])
  long: >-
    push
    + past(speed)
outputs:
  out: {expr: "twice(push, long)", doc: result}
"""


def unmarked(text: str) -> tuple[SourceText, Position]:
    """The text without its mark, and where that stood; before it are no wide characters."""
    before, mark, after = text.partition("|")
    assert mark, "nothing is marked"
    lines = before.split("\n")
    return SourceText("/plant.msnn.yaml", before + after), Position(len(lines) - 1, len(lines[-1]))


def viewed(text: str, known: str = PLANT, folder: str = "") -> tuple[View, Position]:
    """A marked text as it is seen after a text that compiled, and the marked place."""
    source, position = unmarked(text)
    path = str(Path(folder) / source.path) if folder else source.path
    knowledge = Knowledge()
    if known:
        examined = examine(path, known, {})
        assert examined.knowledge is not None, examined.diagnostics
        knowledge = examined.knowledge
    return View(SourceText(path, source.text), knowledge), position


def marked(old: str, new: str) -> str:
    """The plant with a piece of it replaced by one that has the mark."""
    assert PLANT.count(old) == 1, old
    return PLANT.replace(old, new)
