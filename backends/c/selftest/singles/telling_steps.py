"""Chooses few single steps that together show what plain golden steps do not."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from backends.c.selftest.singles.boundaries import Boundaries, Outcomes, boundaries
from backends.c.selftest.singles.changed_operands import Change
from backends.c.selftest.singles.decisions import Decisions
from backends.c.selftest.singles.descent import descended
from backends.c.selftest.singles.drawn_trials import PLAIN, drawn_trials
from backends.c.selftest.singles.slopes_alone import slopes_alone
from backends.c.selftest.singles.trial_steps import Trials, TrialSteps, joined_trials

_RARE = 5
"""A change that shows in fewer of the plain steps may show in no golden step."""
_ASKED = 16
"""Plain steps of which is asked at once what they show."""
_FIRST = 128
"""Steps of which is asked first what they show; of the others only where that is not enough."""
_TRIED = 300_000
"""Pairs of a step and a change that are tried."""
_LIMIT = 1e-2
"""How near a limit is near, relative to it."""
_FEW = 8
"""Of a decision of which both sides are equal in fewer steps more such steps are searched."""
_DESCENT = 1
_HELD = (0.0, 0.5)
"""Of the numbers: decisions that are not equal where all move are searched with some held."""
_MOST = 128
"""Chosen steps of both kinds."""


def telling_steps(
    steps: TrialSteps, decisions: Decisions, seed: int
) -> tuple[list[Trials], list[Trials]]:
    """Steps at which one slope alone is infinite; and steps next to the limits of what is checked,
    or that show a change of an operand which few plain steps and none of the others show.
    """
    random = np.random.Generator(np.random.Philox(seed))
    drawn = drawn_trials(steps, random)

    def outcomes(trials: Trials) -> Outcomes:
        values = steps.run(trials)
        infinite = ~np.isfinite(decisions.doubtful(values, len(trials)))
        signs = decisions.signs(values, len(trials))
        return np.concatenate([signs, np.where(infinite, 1, -1).astype(np.int8)], axis=1)

    beside = boundaries(steps, outcomes, drawn, random)
    found = joined_trials([drawn, *beside.found, beside.equal])
    settled = decisions.settled(steps.run(found), len(found))
    rare = np.arange(len(found)) >= len(found) - len(beside.equal)
    found, rare = found.of(np.flatnonzero(settled)), rare[settled]
    changes = steps.changes()
    left = _rare(found.of(np.arange(min(PLAIN, len(found)))), changes, steps)
    alone = slopes_alone(steps, decisions, random)
    chosen = [*_at_limits(found, decisions, steps), *_both_sides(beside, outcomes, steps)]
    order = random.permutation(len(found))
    # those that are rare stand first
    order, begin, size = order[np.argsort(~rare[order], kind="stable")], 0, _FIRST
    while left and begin < min(len(found), _TRIED // len(left)) and len(chosen) < _MOST:
        left = _choose(found.of(order[begin : begin + size]), left, steps, chosen)
        begin, size = begin + size, 2 * size
    if left and len(chosen) < _MOST:
        # by a generator of its own: what was found without it stays the same
        again = np.random.Generator(np.random.Philox([seed, _DESCENT]))
        hits = (decisions.signs(steps.run(found), len(found)) == 0).sum(axis=0)
        few = np.flatnonzero(hits < _FEW)
        for held in _HELD:
            if not left or not len(few):
                break
            equal = descended(steps, decisions, drawn, few, again, held)
            if not len(equal):
                continue
            values = steps.run(equal)
            settled = decisions.settled(values, len(equal))
            left = _choose(equal.of(np.flatnonzero(settled)), left, steps, chosen)
            hits = (decisions.signs(values, len(equal)) == 0).sum(axis=0)
            few = few[hits[few] == 0]
    return alone[:_MOST], chosen[:_MOST]


def _rare(
    plain: Trials, changes: list[tuple[int, Change]], steps: TrialSteps
) -> list[tuple[int, Change]]:
    """The changes that show in few of the plain steps.

    Most show in nearly all: what has shown often enough is not tried in the other steps.
    """
    counts, open = np.zeros(len(changes), np.int64), np.arange(len(changes))
    for rows in np.split(np.arange(len(plain)), range(_ASKED, len(plain), _ASKED)):
        tried = [changes[k] for k in open]
        counts[open] += steps.seen(plain.of(rows), tried, states=False).sum(axis=0)
        open = np.flatnonzero(counts < _RARE)
    return [changes[k] for k in open]


def _choose(
    part: Trials, left: list[tuple[int, Change]], steps: TrialSteps, chosen: list[Trials]
) -> list[tuple[int, Change]]:
    """Adds the steps of a part that show changes to the chosen ones; the changes still left."""
    seen = steps.seen(part, left)
    chosen += [part.of(np.array([row])) for row in _cover(seen)]
    return [left[k] for k in np.flatnonzero(seen.sum(axis=0) == 0)]


def _both_sides(
    beside: Boundaries, outcomes: Callable[[Trials], Outcomes], steps: TrialSteps
) -> list[Trials]:
    """Pairs of steps, with trained parameters and finite results, between which each decision
    changes: what C decides in its own way, as an interval of a table, is there among it."""
    if not len(beside.below):
        return []
    plain = np.ones(len(beside.below), np.bool_)
    for side in (beside.below, beside.above):
        plain &= np.all(side.numbers[:, steps.tuned] == steps.trained, axis=1)
        values = steps.run(side)
        for value in (*values.outputs.values(), *values.next_states.values()):
            plain &= np.isfinite(value).reshape(len(side), -1).all(axis=1)
    below, above = beside.below.of(plain), beside.above.of(plain)
    rows = _cover(outcomes(below) != outcomes(above)) if plain.any() else []
    return [side.of(np.array([row])) for row in rows for side in (below, above)]


def _at_limits(trials: Trials, decisions: Decisions, steps: TrialSteps) -> list[Trials]:
    """For each limit of a number that the step checks, the steps next to it on both sides.

    Nothing else is outside its range: one bit tells of all numbers.
    """
    rows: dict[int, None] = {}
    for beyond, only in decisions.reports(steps.run(trials), len(trials)):
        for side in (beyond > 0.0, beyond <= 0.0):
            near = np.where(side & only & np.isfinite(beyond), np.abs(beyond), np.inf)
            if near.min(initial=np.inf) < _LIMIT:
                rows[int(np.argmin(near))] = None
    return [trials.of(np.array([row])) for row in rows]


def _cover(seen: NDArray[np.bool_]) -> list[int]:
    """Rows that together have all columns that some row has; the fullest first."""
    rows: list[int] = []
    open = seen.copy()
    while open.any():
        rows.append(int(np.argmax(open.sum(axis=1))))
        open &= ~seen[rows[-1]]
    return rows
