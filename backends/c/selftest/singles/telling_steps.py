"""Chooses few single steps that together detect errors which plain golden steps miss."""

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
"""A change that fewer plain steps detect may remain undetected by golden steps."""
_ASKED = 16
"""Number of plain steps evaluated at once."""
_FIRST = 128
"""Number of steps evaluated first; later batches double in size until all changes are detected."""
_TRIED = 300_000
"""Maximum number of evaluated pairs of a step and a change."""
_LIMIT = 1e-2
"""Maximum distance from a limit, relative to the limit, of a step next to it."""
_FEW = 8
"""Decisions whose sides are equal in fewer steps are searched further."""
_DESCENT = 1
_HELD = (0.0, 0.5)
"""Fractions of elements held fixed in the two searches for equal sides."""
_MOST = 128
"""Maximum number of chosen steps of each of the two kinds."""


def telling_steps(
    steps: TrialSteps, decisions: Decisions, seed: int
) -> tuple[list[Trials], list[Trials]]:
    """The chosen steps: those with a single infinite Jacobian entry, and all others.

    The others lie next to limits, on both sides of decisions, or detect a changed operand that few
    plain steps and no earlier chosen step detect.
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
    """The changes that few plain steps detect.

    Most changes are detected by nearly all steps; once detected often enough, they are not
    evaluated further.
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
    """Adds the steps of a part that detect changes to `chosen`; returns the undetected changes."""
    seen = steps.seen(part, left)
    chosen += [part.of(np.array([row])) for row in _cover(seen)]
    return [left[k] for k in np.flatnonzero(seen.sum(axis=0) == 0)]


def _both_sides(
    beside: Boundaries, outcomes: Callable[[Trials], Outcomes], steps: TrialSteps
) -> list[Trials]:
    """Pairs of close steps between which each decision changes.

    They have trained parameters and finite results. They also test decisions that C makes
    differently, such as the interval of a table.
    """
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
    """For each limit of a checked element, the closest steps on both sides.

    All other elements are in range, because one status bit covers all elements.
    """
    rows: dict[int, None] = {}
    for beyond, only in decisions.reports(steps.run(trials), len(trials)):
        for side in (beyond > 0.0, beyond <= 0.0):
            near = np.where(side & only & np.isfinite(beyond), np.abs(beyond), np.inf)
            if near.min(initial=np.inf) < _LIMIT:
                rows[int(np.argmin(near))] = None
    return [trials.of(np.array([row])) for row in rows]


def _cover(seen: NDArray[np.bool_]) -> list[int]:
    """A small set of rows that together cover all columns, chosen greedily."""
    rows: list[int] = []
    open = seen.copy()
    while open.any():
        rows.append(int(np.argmax(open.sum(axis=1))))
        open &= ~seen[rows[-1]]
    return rows
