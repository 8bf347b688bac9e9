"""Writes what the other scripts measured to `results.json`, and as tables to README.

python results.py
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).parent
KEPT = HERE / "runs"
BEGIN, END = "<!-- figures -->", "<!-- end -->"
PERCENTS = (15, 25, 50, 100)
FARTHEST = 100.0
"""rad²: more is called divergence."""

FRICTIONS = {
    "none": "no friction",
    "least squares": "least squares, viscous + Coulomb",
    "full least squares": "least squares over 1, sin q, cos q",
    "learned": "learned",
    "true": "true friction (floor)",
}


def keep(name: str, found: Any) -> None:
    """Numbers of one script, for the tables."""
    KEPT.mkdir(exist_ok=True)
    text = json.dumps(found, indent=1) + "\n"
    (KEPT / f"{name}.json").write_text(text, encoding="utf-8")


def tables(found: dict[str, Any]) -> str:
    """The tables of README."""
    parts = (_errors(found["errors"]), _series(found["series"]), _tracking(found["tracking"]))
    return "\n\n".join(parts)


def _errors(found: dict[str, list[float]]) -> str:
    mean = {name: float(np.mean(each)) for name, each in found.items()}
    lines = ["| friction | rad² | each joint |", "|---|---|---|"]
    for name, title in FRICTIONS.items():
        each = ", ".join(f"{error:.1e}" for error in found[name])
        lines.append(f"| {title} | {mean[name]:.2g} | {each} |")
    shares = [f"{a / b:.2g}" for a, b in zip(found["learned"], found["true"], strict=True)]
    better, above = mean["least squares"] / mean["learned"], mean["learned"] / mean["true"]
    lines += [
        "",
        f"The learned friction's error is 1/{better:.0f} of what viscous and Coulomb friction have",
        f"by least squares, and {above:.2f} times the floor. Joint by joint it is",
        f"{_listed(shares)} times the floor of the joint.",
    ]
    return "\n".join(lines)


def _listed(words: list[str]) -> str:
    return f"{', '.join(words[:-1])} and {words[-1]}"


def _series(found: dict[str, dict[str, dict[str, float]]]) -> str:
    titles = {name: FRICTIONS.get(name, name) for name in found[str(PERCENTS[-1])]}
    lines = [
        f"| training data, rad² (R²) | {' | '.join(titles.values())} |",
        "|---|" + "---|" * len(titles),
    ]
    for percent in PERCENTS:
        row = found[str(percent)]
        cells = [_cell(row[name]) for name in titles]
        lines.append(f"| {percent} % | {' | '.join(cells)} |")
    return "\n".join(lines)


def _cell(found: dict[str, float]) -> str:
    if found["mse"] > FARTHEST:
        return "diverges"
    r2 = found["r2"]
    return f"{found['mse']:.2g} ({r2:.5f})" if r2 > 0.99 else f"{found['mse']:.2g} ({r2:.2f})"


def _tracking(found: dict[str, dict[str, float]]) -> str:
    lines = ["| friction added to the torques | exact states, mrad | noisy sensors, mrad |"]
    lines.append("|---|---|---|")
    for name, error in found.items():
        lines.append(f"| {name} | {error['exact']:.3g} | {error['noisy']:.3g} |")
    return "\n".join(lines)


def main() -> None:
    file = HERE / "results.json"
    names = ["errors", "series", "tracking", "numbers"]
    found = {"seconds": json.loads(file.read_text(encoding="utf-8"))["seconds"]}
    if (KEPT / "seconds.json").exists():  # of all commands together: `demo.py` alone measures them
        names.append("seconds")
    for name in names:
        text = (KEPT / f"{name}.json").read_text(encoding="utf-8")
        found[name] = json.loads(text, parse_float=lambda number: float(f"{float(number):.7g}"))
    file.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    readme = HERE / "README.md"
    page = readme.read_text(encoding="utf-8")
    before, rest = page.split(BEGIN)
    after = rest.split(END)[1]
    readme.write_text(f"{before}{BEGIN}\n\n{tables(found)}\n\n{END}{after}", encoding="utf-8")


if __name__ == "__main__":
    main()
