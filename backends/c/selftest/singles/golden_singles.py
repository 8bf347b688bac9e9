"""Chooses few single steps as golden vectors, each with its own start, states and parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.c.interface.interface import Interface
from backends.c.interface.status import StatusBit
from backends.c.selftest.golden_vectors import GoldenStart, GoldenVectors
from backends.c.selftest.reference_step import (
    apply_policy,
    equation_bits,
    first_held,
    next_state_bits,
    restarted,
    saturation_bits,
)
from backends.c.selftest.singles.boundaries import Boundaries, Outcomes, boundaries, descended
from backends.c.selftest.singles.changed_operands import Change
from backends.c.selftest.singles.decisions import Decisions
from backends.c.selftest.singles.drawn_trials import PLAIN, drawn_trials
from backends.c.selftest.singles.infinite_derivatives import slopes_alone
from backends.c.selftest.singles.trial_steps import Trials, TrialSteps, joined_trials
from compiler.ir.program import Program

Array = NDArray[Any]


_LARGEST = 8000
"""Maximum number of elements of a step and its Jacobian; thousands of larger steps are too slow."""


@dataclass(frozen=True, slots=True)
class GoldenSingles:
    """Golden vectors of independent single steps, each with its own start, states and
    parameters.
    """

    starts: list[int]
    """Index of the run start that `reset` receives before each step."""
    tuned: list[dict[int, float]]
    """Parameters of each step that differ from the trained ones, by their index in the struct."""
    linearized: int
    """Number of first steps for which only the Jacobian uses changed parameters."""
    vectors: GoldenVectors
    """The states written before each step, and its results; all (count, …)."""

    @property
    def tunes(self) -> bool:
        """True if any step has changed parameters."""
        return any(self.tuned)


def golden_singles(
    program: Program,
    interface: Interface,
    weights: Mapping[str, Array],
    starts: Sequence[GoldenStart],
    seed: int,
) -> GoldenSingles | None:
    """Searches steps that detect errors of C which random golden steps miss. `starts` are those of
    golden runs, from which the steps begin; `weights` are physical arrays by name. None if there
    are no such steps, and for a large program, which only golden runs test.
    """
    steps = TrialSteps(program, interface, weights, starts)
    if steps.computed > _LARGEST:
        return None
    alone, others = telling_steps(steps, Decisions(program, interface), seed)
    if not (alone or others):
        return None
    trials = joined_trials([*alone, *others])
    # for steps of `alone` only the Jacobian uses changed parameters
    stepped = joined_trials([*map(steps.with_trained, alone), *others])
    count = len(trials)
    values, begun, inputs = steps.run(stepped), steps.begun(trials), steps.inputs(trials)
    first = {s.name: begun[s.name] for s in program.states if s.on_range == "reset"}
    status = np.zeros(count, np.uint32)
    after = {name: value.copy() for name, value in values.next_states.items()}
    for k in range(count):
        row = slice(k, k + 1)
        following, outputs, before = (
            {name: value[row] for name, value in each.items()}
            for each in (values.next_states, values.outputs, first)
        )
        bits = _input_bits(interface, {name: value[k] for name, value in inputs.items()})
        bits |= equation_bits(program, outputs, interface.options.dtype)
        bits |= saturation_bits(program, outputs)
        status[k] = bits | next_state_bits(interface, following)
        for name, value in restarted(interface, following, before).items():
            after[name][row] = value
    vectors = GoldenVectors(
        start=starts[0],
        written=steps.written(trials),
        inputs=inputs,
        # the policies replace none of these inputs
        seen=inputs,
        outputs={field.name: values.outputs[field.name] for field in interface.outputs},
        states=after,
        status=status,
        slopes=steps.matrices(trials),
    )
    tuned = trials.numbers[:, steps.tuned]
    # only changed parameters are written: most steps change a few of many
    places = [np.flatnonzero(row != steps.trained).tolist() for row in tuned]
    return GoldenSingles(
        trials.starts.tolist(),
        [{k: float(row[k]) for k in which} for row, which in zip(tuned, places, strict=True)],
        len(alone),
        vectors,
    )


def _input_bits(interface: Interface, inputs: Mapping[str, Array]) -> StatusBit:
    """The status bits that the policies set for one step's inputs, by name. Policies replace none
    of these.
    """
    bits = StatusBit(0)
    for input in interface.inputs:
        name, dtype = input.field.name, interface.options.dtype
        held = first_held(input.port.signal, input.field.shape, dtype)
        bits |= apply_policy(input.port.signal, inputs[name], held, dtype)[1]
    return bits


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
    """The chosen steps: those at which a single Jacobian entry is infinite, and all others. The
    others lie next to limits, on both sides of decisions, or detect a changed operand that few
    random steps and no earlier chosen step detect. Each list has at most `_MOST` elements, which
    are single steps.
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
    """The changes that fewer than `_RARE` of the steps `plain` detect. Most changes are detected by
    nearly all steps; once detected often enough, they are not evaluated further. A change is paired
    with 0 (step) or 1 (Jacobian).
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
    """Adds a few steps of `part` that detect the changes in `left` to the list `chosen`; returns
    the changes that no step of `part` detects.
    """
    seen = steps.seen(part, left)
    chosen += [part.of(np.array([row])) for row in _cover(seen)]
    return [left[k] for k in np.flatnonzero(seen.sum(axis=0) == 0)]


def _both_sides(
    beside: Boundaries, outcomes: Callable[[Trials], Outcomes], steps: TrialSteps
) -> list[Trials]:
    """Pairs of close steps from `beside`, one below and one above the change of a decision;
    together they cover all decisions that change. `outcomes` gives the decisions of steps (B,
    decisions). The pairs have trained parameters and finite results. They also test decisions that
    C makes differently, such as the interval of a table.
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
    """For each limit of a checked element, those of the steps `trials` that are closest on each
    side, if closer than `_LIMIT`. All other elements are in range, because one status bit covers
    all elements.
    """
    rows: dict[int, None] = {}
    for beyond, only in decisions.reports(steps.run(trials), len(trials)):
        for side in (beyond > 0.0, beyond <= 0.0):
            near = np.where(side & only & np.isfinite(beyond), np.abs(beyond), np.inf)
            if near.min(initial=np.inf) < _LIMIT:
                rows[int(np.argmin(near))] = None
    return [trials.of(np.array([row])) for row in rows]


def _cover(seen: NDArray[np.bool_]) -> list[int]:
    """Indices of a small set of rows of a mask, chosen greedily: each column that is True in some
    row is True in one of these.
    """
    rows: list[int] = []
    open = seen.copy()
    while open.any():
        rows.append(int(np.argmax(open.sum(axis=1))))
        open &= ~seen[rows[-1]]
    return rows
