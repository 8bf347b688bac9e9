"""Reduces what was measured to numbers, and writes them as a file and as the tables of README."""

import json
import textwrap
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from judge import CONTROLLERS, PREVIEWING, SEED, Judged
from setting import VARIATIONS

TITLES = {
    "controller": "controller (this example)",
    "mlp": "perceptron",
    "mpc": "predictive",
    "filters": "filters by least squares",
    "kinematic": "kinematic",
    "stanley": "Stanley",
    "vehicle": "learned vehicle, recorded steering",
    "wheels": "kinematic, measured angle of the wheels",
}
BEGIN, END = "<!-- figures -->", "<!-- end -->"


def numbers(judged: Judged, exported: dict[str, Any]) -> dict[str, Any]:
    """Everything that README says, with names."""
    return {
        "open_loop": {
            name: {"mse": trace.mse, "max": trace.worst} for name, trace in judged.traces.items()
        },
        "closed_loop": {
            variation.name: {name: _driven(judged, name, variation.name) for name in CONTROLLERS}
            for variation in VARIATIONS
        },
        "seed": SEED,
        "steered_by": judged.by,
        "solves": _solves(judged),
        "kinematic_lead": judged.lead,
        "finer_steps": judged.finer_steps,
        "translated": judged.translated,
        "export": exported,
    }


def write(found: dict[str, Any], folder: Path) -> None:
    """`results.json`, and between two marks of README the tables of it."""
    rounded = json.loads(json.dumps(found), parse_float=lambda text: float(f"{float(text):.4g}"))
    text = json.dumps(rounded, indent=1) + "\n"
    (folder / "results.json").write_text(text, encoding="utf-8")
    show(tables(rounded), folder / "README.md", BEGIN)


def show(text: str, page: Path, begin: str) -> None:
    """Writes a text between a mark of a page and the next end."""
    before, rest = page.read_text(encoding="utf-8").split(begin)
    _, after = rest.split(END, maxsplit=1)
    page.write_text(f"{before}{begin}\n\n{text}\n\n{END}{after}", encoding="utf-8")


def tables(found: dict[str, Any]) -> str:
    """The tables of README."""
    parts = (_open_loop(found), _closed_loop(found), _solved(found["solves"]))
    return "\n\n".join((*parts, _export(found["export"])))


def _open_loop(found: dict[str, Any]) -> str:
    rows = found["open_loop"]
    lines = [
        "| curvature on the recorded test drive | mean square error, 1/m² | largest, 1/m |",
        "|---|---|---|",
    ]
    for name in ("vehicle", "wheels"):
        lines.append(f"| {TITLES[name]} | {rows[name]['mse']:.2g} | {rows[name]['max']:.2g} |")
    for name in PREVIEWING:
        title = f"{TITLES[name]}, through the learned vehicle"
        lines.append(f"| {title} | {rows[name]['mse']:.2g} | {rows[name]['max']:.2g} |")
    return "\n".join(lines)


def _closed_loop(found: dict[str, Any]) -> str:
    loops = found["closed_loop"]
    lines = [
        "Offset from the middle, largest and rms [m]; steering rate, largest and rms [rad/s]:",
        "",
        f"| controller | {' | '.join(loops)} |",
        "|---|" + "---|" * len(loops),
    ]
    for name in CONTROLLERS:
        cells = [_cell(rows[name]) for rows in loops.values()]
        lines.append(f"| {TITLES[name]} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _cell(row: dict[str, Any]) -> str:
    if not row["arrived"]:
        return "lost"
    return f"{row['max']:.2f}, {row['rms']:.2f}; {row['rate_max']:.2f}, {row['rate_rms']:.3f}"


def _solved(solves: dict[str, Any]) -> str:
    statuses = ", ".join(f"{count:,} {status}" for status, count in solves["statuses"].items())
    median, late, longest = solves["ms"]
    said = (
        f"Statuses of the {solves['count']:,} problems that the predictive controller solves in "
        f"closed loop: {statuses}. It takes {solves['iterations']:.1f} iterations on average, "
        f"{solves['most_iterations']} at most. Called from Python it takes {median:.1f} ms of "
        f"the processor's time in the median, {late:.1f} ms at most in 99 of 100 samples, "
        f"{longest:.0f} ms in the longest."
    )
    return textwrap.fill(said, 100)


def _export(exported: dict[str, Any]) -> str:
    lines = ["| exported C of the controller | |", "|---|---|"]
    lines.append(f"| differing bits along the test drive | {exported['bits']} |")
    board = exported["board"]
    if board is not None:
        least, mean, most = board["instructions"]
        memory = f"{board['flash']}, {board['bss']}, {board['stack_bound']}"
        title = "instructions of a step on a Cortex-M4F, -O2: least, mean, most"
        lines.append(f"| {title} | {least}, {mean:.0f}, {most} |")
        lines.append(f"| flash, RAM, stack, bytes | {memory} |")
    return "\n".join(lines)


def _solves(judged: Judged) -> dict[str, Any]:
    solves = judged.solves
    taken = 1e3 * np.array([solve.taken for solve in solves])
    iterations = [solve.iterations for solve in solves]
    return {
        "count": len(solves),
        "statuses": dict(Counter(solve.status for solve in solves)),
        "iterations": float(np.mean(iterations)),
        "most_iterations": max(iterations),
        "ms": [float(np.median(taken)), float(np.quantile(taken, 0.99)), float(taken.max())],
    }


def _driven(judged: Judged, name: str, variation: str) -> dict[str, Any]:
    run = judged.runs[name, variation]
    offset, rate = np.abs(run.offset), np.abs(run.steering_rate)
    return {
        "arrived": run.arrived,
        "max": float(offset.max()),
        "rms": float(np.sqrt(np.mean(offset**2))),
        "rate_max": float(rate.max()),
        "rate_rms": float(np.sqrt(np.mean(rate**2))),
        "curvature_mse": float(np.mean((run.curvature - run.wanted) ** 2)),
        "sideways": float(np.max(np.abs(run.curvature) * run.speed**2)),
    }
