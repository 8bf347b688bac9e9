"""Writes what was found: `results.json`, the tables of README and the figure."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from closed_loop import LEAK_FROM, Mpc, Run
from plant import SAMPLE_TIME, TOP

matplotlib.use("svg")
from matplotlib import pyplot as plt

TITLES = {"mpc": "predictive", "now": "predictive, told what is wanted now", "pi": "PI"}
ROWS = {
    "rms": "error of the lower level, rms, cm",
    "mean": "mean absolute, cm",
    "leak": "mean absolute over the last 2 minutes, valve open, cm",
    "upper": "highest upper level, limit 11 cm",
    "moves": "sum of moves of the pump, V",
}
STYLE = {"svg.hashsalt": "mpc_tank", "font.size": 9, "lines.linewidth": 0.9}
BEGIN, END = "<!-- figures -->\n", "<!-- end -->"


@dataclass(frozen=True)
class Judged:
    """The runs, and what the predictive controller said on its own."""

    runs: dict[str, Run]
    mpc: Mpc
    pi: tuple[float, float]


def write(judged: Judged, folder: Path) -> str:
    """The three of them; the tables."""
    found = numbers(judged)
    (folder / "results.json").write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")
    text = tables(found)
    page = folder / "README.md"
    before, _, rest = page.read_text(encoding="utf-8").partition(BEGIN)
    after = rest.partition(END)[2]
    page.write_text(f"{before}{BEGIN}\n{text}\n\n{END}{after}", encoding="utf-8")
    _draw(judged, folder / "figures" / "levels.svg")
    return text


def numbers(judged: Judged) -> dict[str, Any]:
    """All figures, as data."""
    found, rivals = judged.mpc.found, np.array(judged.mpc.rivals)
    residuals = [judged.mpc.controller.residuals(each).largest for each in found[::10]]
    return {
        "loop": {name: run.figures for name, run in judged.runs.items()},
        "pi": {"gain": judged.pi[0], "rate": judged.pi[1]},
        "solves": {
            "solver": judged.mpc.controller.solver,
            "statuses": {s: sum(f.status.name == s for f in found) for s in ("SOLVED", "CAPPED")},
            "count": len(found),
            "iterations": float(np.mean([each.iterations for each in found])),
            "worst_residual": max(residuals),
            "ms": _times(judged.mpc.solves),
        },
        "ipopt": {
            "ms": _times(rivals[:, 0].tolist()),
            "volts_apart": float(rivals[:, 1].max()),
            "cost_apart": float(rivals[:, 2].max()),
        },
    }


def tables(found: dict[str, Any]) -> str:
    """The tables of README."""
    lines = [f"| on the rig | {' | '.join(TITLES.values())} |", "|---|" + "---|" * len(TITLES)]
    for key, title in ROWS.items():
        cells = (f"{found['loop'][name][key]:.2f}" for name in TITLES)
        lines.append(f"| {title} | {' | '.join(cells)} |")
    own, ipopt = found["solves"], found["ipopt"]
    times = {
        "`msnn.mpc`, the C called from Python": own["ms"],
        "ipopt, from the plan of the sample before": ipopt["ms"],
    }
    lines += ["", "| at each sample | median, ms | longest, ms |", "|---|---|---|"]
    lines += [f"| {title} | {ms[0]:.1f} | {ms[1]:.0f} |" for title, ms in times.items()]
    said = (
        f"{own['statuses']['SOLVED']} of {own['count']} problems are solved, "
        f"{own['iterations']:.1f} iterations each. The largest residual of the optimality "
        f"conditions, by the interpreter at every tenth, is {own['worst_residual']:.1e}. The "
        f"voltages of both are at most {ipopt['volts_apart']:.1e} V apart, the costs "
        f"{ipopt['cost_apart']:.1e} of the cost."
    )
    lines += ["", said]
    return "\n".join(lines)


def _times(seconds: list[float]) -> list[float]:
    """Median and longest but for the first two, in ms."""
    later = 1e3 * np.array(seconds[2:])
    return [float(np.median(later)), float(later.max())]


def _draw(judged: Judged, path: Path) -> None:
    path.parent.mkdir(exist_ok=True)
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(3, 1, figsize=(8, 6), sharex=True)
        for name, run in judged.runs.items():
            minutes = SAMPLE_TIME * np.arange(run.lower.size) / 60
            colour = {"mpc": "C1", "now": "C0", "pi": "0.6"}[name]
            axes[0].plot(minutes, run.lower, colour, label=TITLES[name])
            axes[1].plot(minutes, run.upper, colour)
            axes[2].step(minutes, run.pump, colour, where="post")
        axes[0].step(minutes, run.wanted, "k--", where="post", label="wanted")
        axes[1].axhline(TOP, color="k", linestyle="--")
        for each in axes:
            each.axvline(LEAK_FROM * SAMPLE_TIME / 60, color="0.8")
        axes[0].legend(loc="lower right", ncols=4, fontsize=7)
        axes[0].set_ylabel("lower level, cm")
        axes[1].set_ylabel("upper level, cm")
        axes[2].set(ylabel="pump, V", xlabel="time, min")
        figure.tight_layout()
        figure.savefig(path, metadata={"Date": None})
        plt.close(figure)
