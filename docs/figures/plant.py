"""Draws `plant.svg`: a spec, its simulation over measurements, and the C that computes it.

    python docs/figures/plant.py [FILE]

Everything in the picture is output of msnn: lines of the spec that `msnn init` writes, a free-run
simulation of the trained model along a test recording, and lines of the exported C.
"""

from __future__ import annotations

import math
import os
import sys
import tempfile
from collections.abc import Iterator, Sequence
from html import escape
from itertools import chain
from pathlib import Path

import numpy as np
import numpy.typing as npt

import msnn
from msnn.project.new_project import new_project

PICTURE = Path(__file__).resolve().with_suffix(".svg")
RECORDING = Path("data", "test", "run_01.csv")

SPEC = (
    "parameters:",
    "  m: ",
    "  c: ",
    "  k: ",
    "states:",
    "  x: {unit: m, der",
    "  v: {unit: m/s, der",
    "equations:",
    "  a: ",
)
"""The first characters of the lines of the spec that are shown."""

CODE = (
    "plant_status_t plant_step(",
    "    plant_state_t *s,",
    "    const PLANT_PLACED",
    "    const plant_in_t *u,",
    "    plant_out_t *y)",
    "{",
    None,
    "    /* spec: a [",
    "    const plant_real a =",
    "    /* spec: v_for_k2 [",
    "    const plant_real v_for_k2",
    "    /* spec: x_for_k2 [",
    "    const plant_real x_for_k2",
    None,
    "    /* spec: x_next",
    "    const plant_real x_next",
    "        + (",
    "    /* outputs */",
    "    y->x_next",
    None,
    "    s->x = x_next",
    "    s->v = v_next",
    None,
    "    return status;",
    "}",
)
"""The same of the C; None is an omission."""

WIDTH, HEIGHT = 1000, 470
INK, DIM, RULE, BLUE, ORANGE = "#1f2328", "#59636e", "#d1d9e0", "#0969da", "#bc4c00"
LEFT, RIGHT, TOP, BOTTOM = 62, 420, 262, 425
"""Edges of the axes in pixels."""

Array = npt.NDArray[np.float64]


def main(file: Path) -> None:
    """Trains, simulates and exports in a folder that goes away, then writes the picture."""
    here = Path.cwd()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        new_project(Path("plant"))
        os.chdir("plant")
        model = msnn.load("plant.msnn.yaml")
        weights = msnn.train(model).weights
        (guess,), (run,) = (msnn.simulate(model, str(RECORDING), w) for w in (None, weights))
        msnn.export(model, "c", "c", weights)
        spec = Path("plant.msnn.yaml").read_text(encoding="utf-8")
        code = Path("c", "src", "plant.c").read_text(encoding="utf-8")
        os.chdir(here)
    step = code[code.index("plant_status_t plant_step(") :]
    positions = [np.ravel(each["x_next"]) for each in (run.logged, run.outputs, guess.outputs)]
    file.write_text(picture(spec, step, np.stack(positions)), encoding="utf-8")


def picture(spec: str, step: str, positions: Array) -> str:
    """The SVG; the rows are measured, simulated and guessed positions in m, every 50 ms."""
    parts = chain(
        _title(20, 27, "The spec: physics, units, unknown parameters"),
        _lines(20, 48, [line.partition("#")[0] for line in _shown(spec, SPEC)]),
        _title(20, 222, "A test recording, simulated from its first row"),
        _plot(positions),
        [f'<path d="M444 14V{HEIGHT - 14}" stroke="{RULE}"/>'],
        _title(456, 27, "The exported C99 that computes it: no allocation, no globals"),
        _lines(456, 48, _shown(step, CODE)),
    )
    body = "\n".join(parts)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" font-size="11">\n'
        f'<rect x="0.5" y="0.5" width="{WIDTH - 1}" height="{HEIGHT - 1}" rx="6" fill="#ffffff" '
        f'stroke="{RULE}"/>\n<g font-family="system-ui,Helvetica,Arial,sans-serif" fill="{DIM}">\n'
        f"{body}\n</g>\n</svg>\n"
    )


def _shown(text: str, begins: Sequence[str | None]) -> list[str]:
    """The lines that begin so, in order."""
    lines = iter(text.splitlines())
    return ["    …" if b is None else next(x for x in lines if x.startswith(b)) for b in begins]


def _title(x: int, y: int, text: str) -> Iterator[str]:
    yield f'<text x="{x}" y="{y}" font-size="12" font-weight="600" fill="{INK}">{text}</text>'


def _lines(x: int, y: int, lines: Sequence[str]) -> Iterator[str]:
    """Code, with comments in another colour."""
    mono = "ui-monospace,SFMono-Regular,Menlo,Consolas,monospace"
    yield f'<g font-family="{mono}" font-size="10.8" fill="{INK}">'
    for number, line in enumerate(lines):
        colour = f' fill="{DIM}"' if "/*" in line or line.strip() == "…" else ""
        text = escape(line.rstrip(), quote=False).replace("  ", "\u00a0\u00a0")
        yield f'<text x="{x}" y="{y + 16 * number}"{colour}>{text}</text>'
    yield "</g>"


def _plot(positions: Array) -> Iterator[str]:
    top = 0.2 * math.ceil(5 * float(np.nanmax(np.abs(positions))))
    middle, scale = (BOTTOM + TOP) / 2, (BOTTOM - TOP) / 2 / top
    for level in (-top, -top / 2, 0.0, top / 2, top):
        y = middle - scale * level
        yield f'<path d="M{LEFT} {y:.1f}H{RIGHT}" stroke="{RULE}"/>'
        yield f'<text x="{LEFT - 6}" y="{y + 4:.1f}" text-anchor="end">{level:.2g}</text>'
    for second in range(0, 11, 2):
        place = f'x="{LEFT + (RIGHT - LEFT) * second / 10:.1f}" y="{BOTTOM + 17}"'
        yield f'<text {place} text-anchor="middle">{second}</text>'
    yield f'<text x="{RIGHT}" y="{BOTTOM + 33}" text-anchor="end">time, s</text>'
    yield f'<text x="20" y="{TOP - 14}">position, m</text>'
    rows = np.arange(1, positions.shape[1] + 1, dtype=np.float64)
    across: Array = LEFT + (RIGHT - LEFT) / 10 * 0.05 * rows
    measured, simulated, guessed = (
        [f"{x:.1f} {y:.1f}" for x, y in zip(across, middle - scale * row, strict=True)]
        for row in positions
    )
    dots = "".join(f"M{point}h0" for point in measured[::2])
    dashes = f'stroke="{DIM}" stroke-dasharray="4 3"'
    yield f'<path d="{dots}" stroke="{BLUE}" stroke-width="5" stroke-linecap="round"/>'
    yield f'<polyline points="{" ".join(guessed)}" fill="none" {dashes}/>'
    line = f'stroke="{ORANGE}" stroke-width="1.5"'
    yield f'<polyline points="{" ".join(simulated)}" fill="none" {line}/>'
    keys = [(112, "measured", f'stroke="{BLUE}" stroke-width="5" stroke-dasharray="0 8"')]
    keys += [(205, "simulated", line), (300, "before training", dashes)]
    for x, text, stroke in keys:
        yield f'<path d="M{x} {TOP - 18}h18" stroke-linecap="round" {stroke}/>'
        yield f'<text x="{x + 24}" y="{TOP - 14}">{text}</text>'


if __name__ == "__main__":
    main(Path(sys.argv[1]).absolute() if len(sys.argv) > 1 else PICTURE)
