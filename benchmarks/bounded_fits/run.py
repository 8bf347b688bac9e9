"""Measures how often fits with bounds reach the minimum, and how often they say so wrongly.

    python benchmarks/bounded_fits/run.py [--write]

All problems of `problems.py` from their initial points: models of NIST with their data, static
laws and differential equations, the minimum inside the bounds or on one. Derivatives are exact.
Every method may take 400 Jacobians. A fit has *reached* the minimum if its loss is within 1 % of
the least that any fit found, these and others from points around the known values. It is *wrongly
converged* if it ends "converged", has a derivative along which it could go on (cosine above 1e-4,
on a bound only inward) and scipy's `trf` lowers its loss from there by more than 1 %. *On the
bound* are those of the reached minima on a bound that have its exact value. Without bounds the
problems are those whose minimum the bounds do not cut off, from the same points and from 12 more
that are wrong by factors of up to 100.

`--write` puts the tables into RESULTS.md.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from benchmarks.bounded_fits.fits import (
    Fit,
    by_msnn,
    by_scipy,
    is_wrongly_converged,
    without_bounds,
)
from benchmarks.bounded_fits.problems import Array, Problem, far_point, problems

HERE = Path(__file__).resolve().parent
ELSEWHERE = 4
"""Points around the known values from which the least loss is looked for."""
FAR = 12
"""Far-off points of each problem without bounds."""


@dataclass
class Row:
    """The counts of one method over all problems."""

    pairs: list[str] = field(default_factory=list[str])
    reached: list[bool] = field(default_factory=list[bool])
    inside: list[bool] = field(default_factory=list[bool])
    beside: list[bool] = field(default_factory=list[bool])
    from_bound: list[bool] = field(default_factory=list[bool])
    exact: list[bool] = field(default_factory=list[bool])
    wrong: list[bool] = field(default_factory=list[bool])
    jacobians: list[int] = field(default_factory=list[int])
    losses: list[int] = field(default_factory=list[int])

    def add(self, problem: Problem, place: int, fit: Fit, least: float) -> None:
        """Adds a fit that began at the initial point with index `place`."""
        reached = fit.reached(least)
        self.pairs.append(f"{problem.name} {place + 1}")
        self.reached.append(reached)
        (self.beside if problem.on_bound else self.inside).append(reached)
        if place == len(problem.points) - 1:
            self.from_bound.append(reached)
        if problem.on_bound and reached:
            self.exact.append(bool(np.any((fit.x == problem.low) | (fit.x == problem.high))))
        self.wrong.append(is_wrongly_converged(problem, fit, least))
        self.jacobians.append(fit.jacobians)
        self.losses.append(fit.losses)

    def cells(self) -> list[str]:
        """The row of the table."""
        counts = (self.inside, self.beside, self.from_bound, self.exact)
        return [
            f"{np.mean(self.reached):.1%}",
            *(f"{sum(each)}/{len(each)}" if each else "" for each in counts),
            str(sum(self.wrong)),
            f"{np.median(self.jacobians):.0f}",
            f"{np.mean(self.losses):.0f}",
        ]


HEADER = (
    "method", "reached", "inside", "minimum on a bound", "begun on a bound", "on the bound",
    "wrongly converged", "Jacobians (median)", "losses (mean)",
)  # fmt: skip


def least_loss(problem: Problem, fits: list[Fit]) -> float:
    """The lowest known loss: of these fits, and of others from points around the known values."""
    random = np.random.Generator(np.random.Philox(5))
    inner = 1e-3 * (problem.high - problem.low)
    low, high = problem.low + inner, problem.high - inner
    finite = np.isfinite(inner)
    low, high = np.where(finite, low, -np.inf), np.where(finite, high, np.inf)
    points = [problem.known] + [
        problem.known * np.exp(random.uniform(-0.7, 0.7, len(low))) for _ in range(ELSEWHERE)
    ]
    for point in points:
        inside = np.clip(point, low, high)
        if np.isfinite(problem.loss(inside)):
            fits = [*fits, by_scipy(problem, inside, most=2000)]
    return min(fit.loss for fit in fits)


def main() -> None:
    """Prints the tables, and writes them where that is asked for."""
    title, _, about = (__doc__ or "").partition("\n")
    parser = argparse.ArgumentParser(description=title)
    parser.add_argument("--write", action="store_true", help="put the tables into RESULTS.md")
    write = parser.parse_args().write
    found = problems()
    bounded = {"levenberg_marquardt": Row(), "scipy trf": Row()}
    free = {"levenberg_marquardt": Row(), "scipy lm (MINPACK)": Row()}
    far = {name: Row() for name in free}
    for problem in found:
        _count(problem, problem.points, bounded, "trf")
        if not problem.on_bound:
            # of the points of its own the last one is on a bound
            _count(without_bounds(problem), problem.points[:-1], free, "lm")
            _count(without_bounds(problem), _far_points(problem), far, "lm")
        print(problem.name, file=sys.stderr, flush=True)
    pairs = sum(len(problem.points) for problem in found)
    text = f"## With bounds: {len(found)} problems, {pairs} pairs of problem and point\n\n"
    text += _table(bounded)
    for title, rows in (("", free), (" from far-off points", far)):
        pairs = len(rows["levenberg_marquardt"].reached)
        text += f"\n## Without bounds{title}: {pairs} pairs\n\n{_table(rows)}\n{_alone(rows)}"
    print(text)
    if write:
        about = about.strip().partition("\n\n")[2].partition("`--write`")[0].strip()
        page = (
            f"# Fits with bounds\n\n{about}\n\n`python benchmarks/bounded_fits/run.py --write`.\n"
        )
        (HERE / "RESULTS.md").write_text(f"{page}\n{text}", encoding="utf-8")


def _far_points(problem: Problem) -> list[Array]:
    random = np.random.Generator(np.random.Philox(777))
    return [far_point(problem, problem.points[0], random) for _ in range(FAR)]


def _count(problem: Problem, points: Sequence[Array], rows: dict[str, Row], method: str) -> None:
    ours = [by_msnn(problem, point) for point in points]
    theirs = [by_scipy(problem, point, method) for point in points]
    least = least_loss(problem, [*ours, *theirs])
    for row, fits in zip(rows.values(), (ours, theirs), strict=True):
        for place, fit in enumerate(fits):
            row.add(problem, place, fit, least)


def _alone(rows: dict[str, Row]) -> str:
    """Text about pairs of problem and initial point that only one of two methods solves."""
    lines: list[str] = []
    for (name, one), (_, other) in zip(rows.items(), reversed(rows.items()), strict=True):
        both = zip(one.pairs, one.reached, other.reached, strict=True)
        alone = [pair for pair, here, there in both if here and not there]
        lines.append(f"Reached by {name} alone, {len(alone)}: {', '.join(alone)}.\n")
    return "\n".join(lines)


def _table(rows: dict[str, Row]) -> str:
    lines = [HEADER, ["---"] * len(HEADER)]
    lines += [[name, *row.cells()] for name, row in rows.items()]
    return "".join(f"| {' | '.join(cells)} |\n" for cells in lines)


if __name__ == "__main__":
    main()
