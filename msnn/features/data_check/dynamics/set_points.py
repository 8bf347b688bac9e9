"""Recognises set-points: columns that the target follows because a controller compares them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from msnn.features.data_check.dynamics.arx import ArxOrders, fit_arx
from msnn.features.data_check.dynamics.influence import Influence, influences
from msnn.features.data_check.dynamics.pieces import Piece, slower

_NAME = re.compile(
    r"(?:^|_)(?:sp|set_?point|setpt|ref|reference|referencia|target|desired|soll|sollwert|command"
    r"|demand)(?:_|\d|$)|_set\d?$|^set$"
)
_LAGS = 5
_COMPUTED = 0.5
"""Minimum fraction of the controlled variable's innovation that set-point and target explain."""
_OPPOSITE = 0.3
"""Maximum |sum of both coefficients| relative to one: a controller reads the difference."""
_LATEST = 2
_BLOCKS = 40
_LEAST_FIT = 0.5
_SLOPES = (0.5, 1.2)
"""Long-run change of the target per change of the set-point; proportional control has below 1."""


@dataclass(frozen=True, slots=True)
class SetPoint:
    """Input `number` is the set-point of the target; input `controller` acts on the difference."""

    number: int
    controller: int | None
    """None if the name and the long-run values alone say it."""


def set_points(pieces: Sequence[Piece], names: Sequence[str] = ()) -> tuple[SetPoint, ...]:
    """The set-points of a target among its inputs.

    Input r is a set-point with controller output u under four conditions: (1) Means of long blocks
    of the target follow r with a gain of 0.5 to 1.2. (2) r and the target explain most of the
    innovation of u. (3) Their coefficients are opposite, as in a controller of r − y. (4) r does
    not help to predict the target beside u. Without a u, (1) and a name such as `sp`, `setpoint`,
    `ref` or `target` are required: an input of a plant with unit gain meets (1) too.
    """
    count = pieces[0].inputs.shape[1] if pieces else 0
    found: list[SetPoint] = []
    for number in range(count):
        if not _follows_in_the_long_run(pieces, number):
            continue
        acting = [u for u in range(count) if u != number and _controls(pieces, number, u)]
        if acting:
            found.append(SetPoint(number, acting[0]))
        elif names and is_named_set_point(names[number]):
            found.append(SetPoint(number, None))
    return tuple(found)


def is_named_set_point(name: str) -> bool:
    """True for names such as `T_set`, `sp`, `yRef`, `Referencia`."""
    words = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name).lower()
    return _NAME.search(words.replace(" ", "_").replace(".", "_")) is not None


def _follows_in_the_long_run(pieces: Sequence[Piece], number: int) -> bool:
    total = sum(map(len, pieces))
    blocks = slower(pieces, max(total // _BLOCKS, 1))
    if not blocks or sum(map(len, blocks)) < 10:
        return False
    y = np.concatenate([block.output for block in blocks])
    r = np.concatenate([block.inputs[:, number] for block in blocks])
    y, r = y - y.mean(), r - r.mean()
    if not (r @ r > 0 and y @ y > 0):
        return False
    slope = float(r @ y / (r @ r))
    fit = float((r @ y) ** 2 / ((r @ r) * (y @ y)))
    return _SLOPES[0] <= slope <= _SLOPES[1] and fit > _LEAST_FIT


def _controls(pieces: Sequence[Piece], number: int, acting: int) -> bool:
    """True if input `acting` is computed from the difference of input `number` and the target."""
    turned = [
        Piece(piece.inputs[:, acting], np.stack((piece.inputs[:, number], piece.output), axis=1))
        for piece in pieces
    ]
    alone = fit_arx(
        [Piece(piece.output, piece.inputs[:, :0]) for piece in turned], ArxOrders(_LAGS, 0)
    )
    both = fit_arx(turned, ArxOrders(_LAGS, _LAGS))
    if alone is None or both is None or not alone.squares > 0:
        return False
    if 1 - both.squares / alone.squares < _COMPUTED:
        return False
    # the difference weighs both alike, whatever the controller does with it; it may read the
    # target some rows later
    of_reference, of_target = both.numerators
    weight = float(np.linalg.norm(of_reference) + np.linalg.norm(of_target)) / 2
    rests = [
        np.linalg.norm(of_reference[: len(of_target) - late] + of_target[late:])
        for late in range(_LATEST + 1)
    ]
    if not min(rests) < _OPPOSITE * weight:
        return False
    # the plant reads u alone: r adds nothing
    beside = [Piece(piece.output, piece.inputs[:, [acting, number]]) for piece in pieces]
    return not _seen(influences(beside)[1])


def _seen(found: Influence | None) -> bool:
    return found is not None and found.seen


def without(pieces: Sequence[Piece], removed: Sequence[int]) -> list[Piece]:
    """The same rows without some inputs."""
    kept = [i for i in range(pieces[0].inputs.shape[1]) if i not in removed] if pieces else []
    return [Piece(piece.output, piece.inputs[:, kept]) for piece in pieces]
