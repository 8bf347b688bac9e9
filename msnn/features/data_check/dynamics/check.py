"""Analyses the response of one series to others: delays, time constants, excitation, feedback."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from msnn.data.dataset import BoolArray, FloatArray
from msnn.features.data_check.dynamics.arx import feedback
from msnn.features.data_check.dynamics.excitation import (
    Dependence,
    Excitation,
    dependences,
    excitation,
)
from msnn.features.data_check.dynamics.impulse_response import (
    Responses,
    TimeConstants,
    responses,
    time_constants,
)
from msnn.features.data_check.dynamics.pieces import Piece, pieces_of, rows_of


@dataclass(frozen=True, slots=True, kw_only=True)
class TargetCheck:
    """The responses of one series to all inputs; lists are in the order of the inputs."""

    rows: int
    """Number of analysed rows."""
    longest: int
    """Length of the longest interval without a gap."""
    responses: Responses | None
    delays: tuple[int | None, ...]
    """None if no response is visible, or if the excitation is too weak."""
    sharp: tuple[bool, ...]
    """True if the response begins at the delay; False if the delay is only an upper limit."""
    constants: TimeConstants | None
    feedback: tuple[float | None, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class InputsCheck:
    """Properties of the inputs themselves."""

    excitation: tuple[Excitation | None, ...]
    dependences: tuple[Dependence, ...]


def check_inputs(
    inputs: FloatArray, follows: BoolArray, steps: Sequence[float | None]
) -> InputsCheck:
    """Excitation and dependence of inputs (rows, inputs); `steps` are their quantisation steps."""
    pieces = pieces_of(np.zeros(len(inputs)), inputs, follows)
    return InputsCheck(
        excitation=tuple(excitation(pieces, i, step) for i, step in enumerate(steps)),
        dependences=dependences(pieces),
    )


def check_target(
    target: FloatArray, inputs: FloatArray, follows: BoolArray, about: InputsCheck
) -> TargetCheck:
    """Analyses the response of `target` to inputs (rows, inputs)."""
    count = inputs.shape[1]
    pieces = pieces_of(target, inputs, follows)
    found = responses(pieces) if count and _moves(pieces) else None
    delays: list[int | None] = []
    for number, excites in enumerate(about.excitation):
        # without excitation an answer cannot be told from none
        told = found is not None and excites is not None and not excites.weak
        delays.append(found.delay(number) if found is not None and told else None)
    return TargetCheck(
        rows=rows_of(pieces),
        longest=max(map(len, pieces), default=0),
        responses=found,
        delays=tuple(delays),
        sharp=tuple(found is not None and found.begins_sharply(i) for i in range(count)),
        constants=None if found is None else time_constants(pieces, found),
        feedback=tuple(feedback(pieces, number) for number in range(count))
        if found
        else (None,) * count,
    )


def _moves(pieces: Sequence[Piece]) -> bool:
    return any(np.ptp(piece.output) > 0 for piece in pieces)
