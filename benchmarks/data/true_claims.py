"""Compares claims of `msnn data` about simulated systems with the truth.

    python benchmarks/data/true_claims.py [--cases 1000] [--seeds 40] [--write]

`--write` writes true_claims.md. Recordings without an influence of the input give the level of the
joint test; systems of known dynamics give its power, delays, time constants, set-points.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))

from benchmarks.data.known_systems import NULLS, SYSTEMS, Case, null_case
from msnn.features.data_check.dynamics.check import TargetCheck, check_inputs, check_target

_PAGE = """\
# Claims of `msnn data` against the truth

Written by `python benchmarks/data/true_claims.py --cases {cases} --seeds {seeds} --write`.

## No influence: how often a response is claimed

{cases} recordings per row. The joint test claims a response below p = 0.01.

| noise of the target | input | rows | p < 0.01 | p < 0.05 | any claim | feedback | set-point |
|---|---|---|---|---|---|---|---|
{nulls}

## Influence: what is found

{seeds} recordings per row. "Dead seen" counts inputs without influence that seem to have one.
"Range" counts ranges of the slowest time constant that contain the true one.

| system | response seen | dead seen | delay right | slowest, true | median | range | set-point |
|---|---|---|---|---|---|---|---|
{systems}
"""


def main() -> None:
    """Prints the page."""
    parser = argparse.ArgumentParser(description="Compares claims with the truth.")
    parser.add_argument("--cases", type=int, default=1000)
    parser.add_argument("--seeds", type=int, default=40)
    parser.add_argument("--write", action="store_true")
    given = parser.parse_args()
    nulls = [_null_row(*kind, given.cases) for kind in NULLS]
    systems = [_system_row(name, given.seeds) for name in SYSTEMS]
    page = _PAGE.format(
        cases=given.cases, seeds=given.seeds, nulls="\n".join(nulls), systems="\n".join(systems)
    )
    print(page)
    if given.write:
        Path(__file__).with_suffix(".md").write_text(page, encoding="utf-8")


def checked(case: Case) -> TargetCheck:
    """What `msnn data` finds; columns have no names that would tell a set-point."""
    follows = np.ones(len(case.target), dtype=np.bool_)
    follows[:1] = False
    about = check_inputs(case.inputs, follows, [None] * case.inputs.shape[1])
    return check_target(case.target, case.inputs, follows, about)


def _null_row(noise: str, input: str, rows: int, cases: int) -> str:
    chances, claims, feedback, set_points = np.ones(cases), 0, 0, 0
    for seed in range(cases):
        found = checked(null_case(noise, input, rows, np.random.default_rng(seed)))
        answer = found.answers[0]
        if answer is not None:
            chances[seed] = answer.p_value
            claims += answer.seen
        feedback += found.feedback[0] is not None
        set_points += len(found.set_points)
    shares = (np.mean(chances < 0.01), np.mean(chances < 0.05), claims / cases, feedback / cases)
    parts = [f"{share:.1%}" for share in (*shares, set_points / cases)]
    return f"| {noise} | {input} | {rows} | {' | '.join(parts)} |"


def _system_row(name: str, seeds: int) -> str:
    seen, dead, delays, inside, set_points = 0, 0, 0, 0, 0
    slowest: list[float] = []
    cases = [SYSTEMS[name](np.random.default_rng(seed)) for seed in range(seeds)]
    case = cases[0]
    for case in cases:
        found = checked(case)
        references = {one.number for one in found.set_points}
        for number, acts in enumerate(case.acts):
            answer = found.answers[number]
            claimed = number not in references and answer is not None and answer.seen
            seen += claimed and acts
            dead += claimed and not acts
        set_points += len(references)
        delays += found.delays[0] == case.delay
        if found.constants is not None:
            low, high = found.constants.interval
            slowest.append(found.constants.slowest)
            inside += case.constant is not None and low <= case.constant <= high
    true = "" if case.constant is None else f"{case.constant:.1f}"
    median = f"{np.median(slowest):.1f}" if slowest else "not told"
    told = len(slowest)
    of = f"{inside} of {told}" if case.constant is not None and told else ""
    right = "" if case.delay is None else f"{delays} of {seeds}"
    return (
        f"| {name} | {seen} of {seeds} | {dead} | {right} | {true} | {median} | {of} "
        f"| {set_points} |"
    )


if __name__ == "__main__":
    main()
