"""Analyses the response of one series to others: delays, time constants, excitation, feedback."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

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
from msnn.features.data_check.dynamics.influence import SIGNIFICANCE, influences
from msnn.features.data_check.dynamics.pieces import Piece, pieces_of, rows_of
from msnn.features.data_check.dynamics.set_points import SetPoint, set_points, without


@dataclass(frozen=True, slots=True, kw_only=True)
class JointTest:
    """The result of joint tests for a response of the target to one input beside the others."""

    p_value: float
    """Probability of data this far from no response, if there is none."""
    in_row: bool
    """True if the two move together in the same row: feedthrough, or a controller."""
    alone: bool
    """True if the input without the others seems to have a response."""
    lags: int
    limited: bool
    """True if a static effect worth modelling is possible although no response is seen."""
    static: float
    """Upper limit of |static gain| · std(input) / std(target)."""

    @property
    def seen(self) -> bool:
        return self.p_value < SIGNIFICANCE or self.in_row or self.alone


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
    answers: tuple[JointTest | None, ...]
    """The joint test of each input; None if the data cannot test it."""
    set_points: tuple[SetPoint, ...]

    def set_point(self, number: int) -> SetPoint | None:
        """The role of input `number` as a set-point, if it has one."""
        return next((one for one in self.set_points if one.number == number), None)


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
    target: FloatArray,
    inputs: FloatArray,
    follows: BoolArray,
    about: InputsCheck,
    names: Sequence[str] = (),
) -> TargetCheck:
    """Analyses the response of `target` to inputs (rows, inputs) with `names`, if they have any.

    Set-points are no inputs of the plant: responses to the others are estimated without them.
    """
    count = inputs.shape[1]
    pieces = pieces_of(target, inputs, follows)
    moves = bool(count) and _moves(pieces)
    references = set_points(pieces, names) if moves else ()
    back: list[float | None] = [None] * count
    if moves:
        back = [feedback(pieces, number) for number in range(count)]
    left_out = {one.number for one in references}
    if len(left_out) == count:
        # without an input of the plant, the closed loop is what the columns show
        left_out.clear()
    plant = [number for number in range(count) if number not in left_out]
    closed = any(back[number] is not None for number in plant)
    closed |= any(one.controller is not None for one in references)
    reduced = without(pieces, sorted(left_out)) if left_out else pieces
    of_plant = responses(reduced, int(closed)) if moves and plant else None
    found = of_plant
    if of_plant is not None and left_out:
        found = _with_set_points(of_plant, plant, count)
    delays: list[int | None] = []
    for number, excites in enumerate(about.excitation):
        # without excitation an answer cannot be told from none
        told = found is not None and excites is not None and not excites.weak
        delays.append(found.delay(number) if found is not None and told else None)
    answers: list[JointTest | None] = [None] * count
    if of_plant is not None:
        for number, answer in zip(plant, _answers(reduced, of_plant), strict=True):
            answers[number] = answer
    return TargetCheck(
        rows=rows_of(pieces),
        longest=max(map(len, pieces), default=0),
        responses=found,
        delays=tuple(delays),
        sharp=tuple(found is not None and found.begins_sharply(i) for i in range(count)),
        constants=None if of_plant is None else time_constants(reduced, of_plant),
        feedback=tuple(back) if found else (None,) * count,
        answers=tuple(answers),
        set_points=references,
    )


_IN_ROW = 5.0
"""Standard errors beyond which the coefficient of the same row is no chance."""


def _answers(pieces: Sequence[Piece], found: Responses) -> list[JointTest | None]:
    """Joint tests of all inputs, by groups of lags and by all lags one by one."""
    count = pieces[0].inputs.shape[1]
    grouped = influences(pieces)
    in_row = [found.in_row(number) > _IN_ROW for number in range(count)]
    # a coefficient of the same row under feedback spoils those of all lags
    model = responses(pieces, 1) if any(in_row) else found
    answers: list[JointTest | None] = []
    for number, group in enumerate(grouped):
        if group is None or model is None:
            answers.append(None)
            continue
        # the smaller of two p-values, for two tests (Bonferroni)
        p_value = min(2 * min(group.p_value, model.p_value(number)), 1.0)
        alone = False
        if p_value >= SIGNIFICANCE and count > 1:
            # inputs that hide each other are not without influence
            (single,) = influences(without(pieces, [i for i in range(count) if i != number]))
            alone = single is not None and single.p_value < SIGNIFICANCE
        answers.append(
            JointTest(
                p_value=p_value,
                in_row=in_row[number],
                alone=alone,
                lags=group.lags,
                limited=group.limited,
                static=group.static,
            )
        )
    return answers


def _with_set_points(of_plant: Responses, plant: Sequence[int], count: int) -> Responses:
    """Responses to all inputs: those of the plant, and 0 for set-points."""
    values = np.zeros((count, of_plant.lags))
    errors = np.zeros_like(values)
    values[list(plant)], errors[list(plant)] = of_plant.values, of_plant.errors
    return replace(of_plant, values=values, errors=errors)


def _moves(pieces: Sequence[Piece]) -> bool:
    return any(np.ptp(piece.output) > 0 for piece in pieces)
