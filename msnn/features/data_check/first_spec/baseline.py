"""Selects the linear model of a new spec: inputs, outputs, delays, orders, rollouts."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from msnn.data.dataset import BoolArray, FloatArray
from msnn.features.data_check.dynamics.arx import (
    Arx,
    ArxOrders,
    chi_square_quantile,
    feedback,
    fit_arx,
)
from msnn.features.data_check.dynamics.impulse_response import Responses, responses, time_constants
from msnn.features.data_check.dynamics.orders import proposed_orders
from msnn.features.data_check.dynamics.pieces import Piece, pieces_of
from msnn.features.data_check.dynamics.set_points import set_points, without
from msnn.features.data_check.first_spec.columns import FoundColumn
from msnn.features.data_check.first_spec.least_squares import (
    ArxEquation,
    ArxTerm,
    FittedRows,
    fit,
    free_run,
    largest_pole,
    relative_error,
)

_ORDERS = (1, 2, 3, 4, 6, 8, 12, 16, 20)
_AS_GOOD = 1.02
"""Minimum ratio of errors for selecting a larger model: 2 %."""
_USEFUL = 0.9
"""Maximum error of a simulation, relative to a constant, that shows which model is better."""
VALIDATION = 0.2
_LONGEST_ROLLOUT = 200
_MOST_CHOICES = 12
"""Maximum number of inputs that are left out one by one for comparison."""
_FEWEST_DIGITS = 6
_SAME = 1.001
"""Maximum ratio of errors after rounding the weights."""


@dataclass(frozen=True, slots=True)
class LeftOut:
    """A column that is no input of the model, and the reason."""

    column: FoundColumn
    reason: str


@dataclass(frozen=True, slots=True)
class SeenDelay:
    """The delay of an input as the data show it."""

    rows: int
    """Rows to the first effect, at least 1."""
    is_seen: bool
    is_immediate: bool
    """True if the effect begins in the same row, which a prediction cannot use."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Baseline:
    """An equation for each target, fitted by least squares."""

    equations: tuple[ArxEquation, ...]
    """Columns of terms count along the targets, then the inputs."""
    inputs: tuple[FoundColumn, ...]
    left_out: tuple[LeftOut, ...]
    delays: Mapping[tuple[int, int], SeenDelay]
    """By the indices of target and column."""
    horizon: int
    """Length of rollouts: three time constants, limited by the recordings."""
    constant_errors: tuple[float, ...]
    """RMS of the held-out rows of each target around the mean of the others."""
    held_errors: tuple[float, ...]
    """RMS error of the previous row as prediction, in the held-out rows."""


def choose_baseline(
    targets: Sequence[FoundColumn],
    inputs: Sequence[FoundColumn],
    follows: BoolArray,
    held_out: BoolArray,
) -> Baseline:
    """The smallest model that simulates the held-out rows about as well as the best one.

    Inputs are left out if they are set-points, or if the data show no response to them.
    """
    columns = [*targets, *inputs]
    rows = FittedRows(
        table=np.stack([column.values for column in columns], axis=1),
        targets=len(targets),
        follows=follows,
        held_out=held_out,
    )
    table = rows.table[:, len(targets) :]
    pieces = [pieces_of(target.values, table, follows) for target in targets]
    goals = _set_points(pieces, [column.name for column in inputs])
    left_out = [
        LeftOut(
            inputs[number],
            f"looks like the set-point of {targets[target].name}, from which "
            f"{inputs[controller].name} is computed",
        )
        for number, (target, controller) in goals.items()
    ]
    plant = [number for number in range(len(inputs)) if number not in goals]
    pieces = [without(each, list(goals)) for each in pieces]
    # under feedback, the input of a row is computed from the output of the same row
    found = [responses(each, int(bool(goals))) for each in pieces]
    used = [len(targets) + number for number in plant]
    delays = {
        (k, c): _seen_delay(found[k], i) for k in range(len(targets)) for i, c in enumerate(used)
    }
    sharp = {
        (k, c)
        for k, response in enumerate(found)
        for i, c in enumerate(used)
        if response is not None and response.begins_sharply(i)
    }
    answered = {
        c: any(r is None or r.delay(i) is not None or r.shows(i) for r in found)
        for i, c in enumerate(used)
    }
    orders = tuple(sorted({*_ORDERS}.union(*(proposed_orders(each) for each in pieces))))
    choice = _Choice(rows, delays, sharp, orders)
    best = choice.best(used)
    controllers = {len(targets) + controller for _, controller in goals.values()}
    for column in used if len(used) <= _MOST_CHOICES else ():
        if column in controllers:
            continue
        others = [other for other in used if other != column]
        limit, reason = best.error / _AS_GOOD, "makes the simulation of the last fifth worse"
        if not answered[column]:
            limit, reason = _AS_GOOD * best.error, "has no visible effect in these data"
        smaller = choice.best(others)
        if smaller.error <= limit:
            left_out.append(LeftOut(columns[column], reason))
            used, best = others, smaller
    kept = [*range(len(targets)), *used]
    rows = replace(rows, table=rows.table[:, kept])
    renumbered = {old: new for new, old in enumerate(kept)}
    equations = tuple(
        replace(e, terms=tuple(replace(t, column=renumbered[t.column]) for t in e.terms))
        for e in best.equations
    )
    late = [np.where(held_out, target.values, np.nan) for target in targets]
    early = [float(np.nanmean(np.where(held_out, np.nan, t.values))) for t in targets]
    depth = max(equation.depth for equation in equations)
    return Baseline(
        equations=_rounded(rows, equations),
        inputs=tuple(columns[column] for column in used),
        left_out=tuple(left_out),
        delays={(k, renumbered[c]): d for (k, c), d in delays.items() if c in renumbered},
        # with the data as they are: the time constants do not depend on the delays
        horizon=max(
            _horizon(each, response, depth, int(held_out.sum()))
            for each, response in zip(pieces, found, strict=True)
        ),
        constant_errors=tuple(_rms(v - m) for v, m in zip(late, early, strict=True)),
        held_errors=tuple(_rms(v[1:] - v[:-1]) for v in late),
    )


_HALF = 0.5
"""Error of a simulation, relative to a constant, that a model without set-points may have."""


@dataclass(frozen=True, slots=True)
class _Candidate:
    equations: tuple[ArxEquation, ...]
    error: float
    """Error of the simulation, relative to a constant."""
    one_step: float
    stable: bool

    @property
    def weights(self) -> int:
        return sum(equation.taps.size for equation in self.equations)


@dataclass(frozen=True, slots=True)
class _Choice:
    """Selects orders, delays and couplings for some inputs."""

    rows: FittedRows
    delays: Mapping[tuple[int, int], SeenDelay]
    sharp: Collection[tuple[int, int]]
    orders: Sequence[int]

    def best(self, used: Sequence[int]) -> _Candidate:
        """The smallest of about the best models; an order of 1 without weights if none fits."""
        tried: list[_Candidate] = []
        for coupled in (False, True) if self.rows.targets > 1 else (False,):
            # both are tried: the first effect that the responses show may be later than the true
            # one, as a response that rises slowly has begun earlier
            sets = [
                [self._terms(k, used, coupled, late) for k in range(self.rows.targets)]
                for late in (False, True)
            ]
            for terms in sets[:1] if sets[0] == sets[1] else sets:
                tried.append(self._of_orders(terms))
        return _smallest(tried)

    def _terms(self, target: int, used: Sequence[int], coupled: bool, late: bool) -> list[ArxTerm]:
        own = [ArxTerm(k, 1) for k in range(self.rows.targets) if coupled or k == target]
        return own + [
            ArxTerm(c, self.delays[target, c].rows if late or (target, c) in self.sharp else 1)
            for c in used
        ]

    def _of_orders(self, terms: Sequence[Sequence[ArxTerm]]) -> _Candidate:
        tried: list[_Candidate] = []
        for order in self.orders:
            fits = [fit(self.rows, k, each, order) for k, each in enumerate(terms)]
            equations = tuple(equation for equation in fits if equation is not None)
            if len(equations) < len(fits):
                break
            steps = np.stack([equation.one_step(self.rows) for equation in equations], axis=1)
            tried.append(
                _Candidate(
                    equations,
                    relative_error(self.rows, free_run(self.rows, equations)),
                    relative_error(self.rows, steps),
                    largest_pole(equations) < 1,
                )
            )
        if tried:
            return _smallest(tried)
        # too few rows: what was there before, the last value
        zeros = tuple(
            ArxEquation(
                terms=tuple(each),
                taps=np.array([[float(term.column == k)] for term in each]),
                offset=0.0,
            )
            for k, each in enumerate(terms)
        )
        return _Candidate(zeros, np.inf, np.inf, stable=False)


def _smallest(tried: Sequence[_Candidate]) -> _Candidate:
    """The model with the fewest weights of those that simulate about as well as the best one.

    One-step errors decide where no simulation is better than a constant, as without inputs. A model
    whose errors grow must be much better than those of stable ones.
    """
    stable = [c for c in tried if c.stable and np.isfinite(c.error)]
    others = min((c.error for c in tried), default=np.inf)
    kept = stable if stable and min(c.error for c in stable) * _HALF <= others else list(tried)
    best = min(c.error for c in kept)
    if best < _USEFUL:
        return min((c for c in kept if c.error <= _AS_GOOD * best), key=lambda c: c.weights)
    steps = min(c.one_step for c in kept)
    # infinite where nothing could be fitted
    return min((c for c in kept if c.one_step <= _AS_GOOD * steps), key=lambda c: c.weights)


def _rounded(rows: FittedRows, equations: Sequence[ArxEquation]) -> tuple[ArxEquation, ...]:
    """The equations with as few digits as change their simulation by less than 0.1 %."""
    exact = relative_error(rows, free_run(rows, equations))
    for digits in range(_FEWEST_DIGITS, 16, 2):
        short = tuple(equation.rounded(digits) for equation in equations)
        if relative_error(rows, free_run(rows, short)) <= _SAME * exact + _ROUNDING:
            return short
    return tuple(equations)


_ROUNDING = 1e-6
"""Accepted increase of the relative error by rounding."""


def _seen_delay(found: Responses | None, number: int) -> SeenDelay:
    delay = None if found is None else found.delay(number)
    return SeenDelay(max(delay or 1, 1), delay is not None, delay == 0)


def _set_points(
    pieces: Sequence[Sequence[Piece]], names: Sequence[str]
) -> dict[int, tuple[int, int]]:
    """The set-points among the inputs: their targets, and the inputs that controllers compute.

    A set-point by its name alone counts if another input is under feedback from the target.
    """
    found: dict[int, tuple[int, int]] = {}
    for target, each in enumerate(pieces):
        goals = {goal.number: goal.controller for goal in set_points(each, names)}
        for number, controller in goals.items():
            others = [i for i in range(len(names)) if i not in goals]
            if controller is None:
                controller = next((i for i in others if feedback(each, i) is not None), None)
            if controller is not None:
                found.setdefault(number, (target, controller))
    # some input must remain
    return found if len(found) < len(names) else {}


def _horizon(pieces: Sequence[Piece], found: Responses | None, past: int, late: int) -> int:
    constants = None if found is None else time_constants(pieces, found)
    wanted = 3 * constants.slowest if constants is not None else 20.0
    longest = max(map(len, pieces), default=0)
    # the validation rows must hold a rollout, the training rows several
    room = min(late - past - 1, (longest - past) // 4)
    return int(max(min(wanted, _LONGEST_ROLLOUT, room), 1))


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.nanmean(values**2))) if np.isfinite(values).any() else 0.0


_LAGS = 5
_LEAST_SHARE = 0.02
_CHANCE = 1e-3
_COMPUTED = 0.5
"""Fraction of the innovation explained in the same row, typical for computed control signals."""


@dataclass(frozen=True, slots=True)
class ColumnRole:
    """The fraction of a column's innovation explained by the past of the others."""

    column: FoundColumn
    explained: float
    output: bool
    """True if this is significant, and the column is not computed from others in the same row."""


def roles_of(
    columns: Sequence[FoundColumn], follows: BoolArray, without: Sequence[FoundColumn] = ()
) -> list[ColumnRole]:
    """The role of each column; the columns `without` are not used as explanations.

    An output depends on the past of other columns (Granger's test). So does a control signal,
    because it follows the output, but most of its innovation is explained in the same row.
    """
    return [_role(column, columns, follows, without) for column in columns]


def _role(
    column: FoundColumn,
    columns: Sequence[FoundColumn],
    follows: BoolArray,
    without: Sequence[FoundColumn],
) -> ColumnRole:
    others = [c for c in columns if c is not column]
    if not others or _stands_still(column):
        return ColumnRole(column, 0.0, output=False)
    past = _left(column, [c for c in others if all(c is not w for w in without)], follows, first=1)
    alone = _left(column, [], follows, first=1)
    if past is None or alone is None:
        return ColumnRole(column, 0.0, output=False)
    share = max(1 - past.squares / alone.squares, 0.0)
    # likelihood ratio n ln(RSS₁ / RSS₂), χ² with as many degrees of freedom as taps that were added
    statistic = -alone.rows * math.log(max(1 - share, 1e-300))
    seen = share > _LEAST_SHARE and statistic > chi_square_quantile(_LAGS * len(others), _CHANCE)
    # with `without` again: a command is computed of the output that is to be predicted
    computed = _is_computed(column, others, follows)
    return ColumnRole(column, share, output=seen and not computed)


def _is_computed(column: FoundColumn, others: Sequence[FoundColumn], follows: BoolArray) -> bool:
    """True if others explain most of a column's innovation in the same row."""
    both = _left(column, others, follows, first=1)
    same_row = _left(column, others, follows, first=0)
    if both is None or same_row is None:
        return False
    return 1 - same_row.squares / both.squares > _COMPUTED


def _left(
    column: FoundColumn, others: Sequence[FoundColumn], follows: BoolArray, *, first: int
) -> Arx | None:
    """A model of a column from its own past and that of others, from lag `first`."""
    table = np.zeros((len(follows), len(others)))
    for number, other in enumerate(others):
        table[:, number] = other.values
    pieces: list[Piece] = pieces_of(column.values, table, follows)
    return fit_arx(pieces, ArxOrders(_LAGS, _LAGS, first=first))


def _stands_still(column: FoundColumn) -> bool:
    """True if most rows repeat the previous one, like a held command."""
    # its jumps follow no past of anything, and would pass the test by chance
    known = column.values[np.isfinite(column.values)]
    return float(np.median(np.abs(np.diff(known)))) == 0
