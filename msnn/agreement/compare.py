"""Compares a loaded export with the judge: one step from its states, a free run, and bits."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from compiler.ir.program import Program
from compiler.jacobian.interpret import JacobianInterpreter
from msnn.agreement.deviation import bits_of_each, deviations, worst_deviation
from msnn.agreement.judgement import Arrays, Judge, Judgement, NumberType, Promise
from msnn.agreement.loaded import Loaded, Slopes, Step
from msnn.agreement.record import Record
from msnn.agreement.rounding import (
    STEP_LIMIT,
    labelled,
    rounding_errors,
    single_steps,
    step_limit,
)
from msnn.data.dataset import FloatArray

T = TypeVar("T")

FREE_STEPS = 1000
LINEARIZED_STEPS = 200


@dataclass(frozen=True, slots=True, kw_only=True)
class Subject:
    """What is compared with a judge: an export's program and weights, and what it promises."""

    target: str
    dtype: NumberType
    program: Program
    weights: Mapping[str, FloatArray]
    promise: Promise
    judge: Judge


@dataclass(frozen=True, slots=True)
class Fault:
    """An output or a state in which a target is not what it promises."""

    of: str
    deviation: float | None
    """Of one step, relative to the largest magnitude; None where bits are promised."""
    limit: float | None
    bits: int | None
    """Values whose bits differ."""


@dataclass(frozen=True, slots=True)
class Agreement:
    """How far one target is from the judge, relative to each signal's largest magnitude."""

    target: str
    dtype: str
    steps: int
    one_step: float | None
    """The worst of all steps, each from the judge's state; None where states cannot be set."""
    free_run: float
    """The worst of a free run of at most 1,000 steps; grows where the model is unstable."""
    bits: int | None
    """Values whose bits differ from the judge's in the same arithmetic, where bits are promised."""
    faults: tuple[Fault, ...]
    """Where the target breaks its promise: of bits where it has one, else of near numbers."""
    rounding: dict[str, float]
    """What single precision costs the interpreter itself, of outputs where that is much."""

    @property
    def agrees(self) -> bool:
        """Whether the target keeps what it promises."""
        return not self.faults


def compare(subject: Subject, loaded: Loaded, record: Record) -> Agreement:
    """Runs a loaded export along the record.

    One that promises bits is judged by those of the judge in its arithmetic: how far these are from
    float64 is a property of the model, which is told and not judged.
    """
    exact = subject.promise is Promise.BITS
    assert exact or loaded.step is not None, "without single steps there is nothing to be near to"
    wanted = subject.judge("float64")
    same = subject.judge(subject.dtype) if exact else wanted
    free = _free_run(loaded, same, same.steps if exact else FREE_STEPS)
    single = _single_steps(subject, loaded.step, wanted, record)
    slopes, expected = _slopes(subject, loaded.slopes, same, record)
    near = dict(single.deviations)
    if exact:
        counts = dict(single.bits)
        for name, count in labelled(bits_of_each(free, same.outputs), {}).items():
            counts[name] = counts.get(name, 0) + count
        counts |= _of_matrices(bits_of_each(slopes, expected))
        bits, faults = sum(counts.values()), _different(counts)
    else:
        near |= _of_matrices(deviations(slopes, expected))
        bits, faults = None, _far(subject, near, single.rounding)
    beginning = {name: values[:FREE_STEPS] for name, values in free.items()}
    return Agreement(
        target=subject.target,
        dtype=subject.dtype,
        steps=same.steps,
        one_step=None if loaded.step is None else max(near.values(), default=0.0),
        free_run=worst_deviation(beginning, wanted.outputs),
        bits=bits,
        faults=faults,
        rounding=_costly(subject, wanted, single.rounding),
    )


def _free_run(loaded: Loaded, judged: Judgement, most_steps: int) -> Arrays:
    steps = min(judged.steps, most_steps)
    inputs = {name: values[:steps] for name, values in judged.inputs.items()}
    return loaded.run(judged.beginning, inputs, steps)


@dataclass(frozen=True, slots=True)
class _SingleSteps:
    """Of outputs and next states of steps that each begin at the judge's state."""

    deviations: Mapping[str, float]
    rounding: Mapping[str, float]
    """What the interpreter in single precision is off."""
    bits: Mapping[str, int]
    """Values that differ from that interpreter's, where bits are promised."""


def _single_steps(
    subject: Subject, step: Step | None, wanted: Judgement, record: Record
) -> _SingleSteps:
    if step is None:
        return _SingleSteps({}, {}, {})
    found = labelled(*step(wanted.inputs, wanted.states, wanted.steps))
    single = single_steps(subject.program, subject.weights, record, wanted)
    exact = subject.promise is Promise.BITS
    rounded = labelled(single["outputs"], single["next_states"])
    return _SingleSteps(
        deviations(found, labelled(wanted.outputs, wanted.next_states)),
        rounding_errors(single, wanted),
        bits_of_each(found, rounded) if exact else {},
    )


def _slopes(
    subject: Subject, slopes: Slopes | None, judged: Judgement, record: Record
) -> tuple[Arrays, Arrays]:
    """The matrices that a target has, and what the interpreter says of them in its arithmetic."""
    if slopes is None:
        return {}, {}
    steps = min(judged.steps, LINEARIZED_STEPS)
    inputs, states = (
        {name: values[:steps] for name, values in arrays.items()}
        for arrays in (judged.inputs, judged.states)
    )
    found = slopes.at(inputs, states, steps)
    log = {name: series.astype(subject.dtype) for name, series in record.log.items()}
    own = JacobianInterpreter(slopes.jacobian, subject.program, subject.weights, subject.dtype)
    expected = own.matrices(log, record.t0 + np.arange(steps), states)
    return found, {name: expected[name] for name in found}


def _of_matrices(values: Mapping[str, T]) -> dict[str, T]:
    return {f"the matrix {name}": value for name, value in values.items()}


def _far(
    subject: Subject, found: Mapping[str, float], errors: Mapping[str, float]
) -> tuple[Fault, ...]:
    """The values that are farther from the judge than rounding explains."""
    limits = {name: step_limit(subject.dtype, errors.get(name, 0.0)) for name in found}
    return tuple(
        Fault(name, deviation, limits[name], None)
        for name, deviation in found.items()
        if not deviation <= limits[name]
    )


def _different(counts: Mapping[str, int]) -> tuple[Fault, ...]:
    return tuple(Fault(name, None, None, count) for name, count in counts.items() if count)


def _costly(subject: Subject, wanted: Judgement, errors: Mapping[str, float]) -> dict[str, float]:
    """The outputs that single precision gets wrong in the interpreter too, of targets in it."""
    if subject.dtype != "float32":
        return {}
    outputs = {name: errors[name] for name in labelled(wanted.outputs, {}) if name in errors}
    return {n: error for n, error in outputs.items() if not error <= STEP_LIMIT[subject.dtype]}
