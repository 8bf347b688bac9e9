"""Compares a loaded export with the reference: start, single steps, simulation, Jacobian, bits."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from msnn.agreement.agreement import Agreement, FarStep, Fault, beyond_proof, other_bits
from msnn.agreement.jacobian import measured_slopes
from msnn.agreement.judge import begun_again, outside
from msnn.agreement.judgement import (
    AgreementRecord,
    Arrays,
    Beginning,
    Judgement,
    Loaded,
    labelled,
    labelled_first,
)
from msnn.agreement.rounding import (
    STEP_LIMIT,
    branches,
    first_states,
    single_steps,
    step_limit,
    within_rounding,
)
from msnn.agreement.subject import (
    NOTHING,
    Deviations,
    Subject,
    bits_of_each,
    deviations,
    worst_deviation,
)

FREE_STEPS = 1000


def compare(subject: Subject, loaded: Loaded, record: AgreementRecord) -> Agreement:
    """Runs a loaded export on recorded inputs, and compares it with the reference.

    An export that promises identical bits is compared with the reference in its own arithmetic. Its
    difference from float64 is a property of the model, and is reported only. With a proven error
    bound, as in fixed point, the reference itself is checked against it.
    """
    exact = subject.is_exact
    assert exact or loaded.step is not None, "without single steps there is nothing to be near to"
    wanted = subject.judge("float64")
    same = subject.judge(subject.dtype) if exact else wanted
    # bits are compared to the end of the record; near numbers drift apart, and a run of a thousand
    # steps tells as much
    free = _free_run(loaded, same, same.steps if exact else FREE_STEPS)
    single = _start_and_steps(subject, loaded, same.beginning, wanted, record)
    exported = loaded.slopes()
    slopes = measured_slopes(subject, exported, same)
    if exact:
        counts = {**single.measured.bits, **slopes.bits}
        for name, count in labelled(bits_of_each(free, same.outputs), {}).items():
            counts[name] = counts.get(name, 0) + count
        bits = sum(counts.values())
        faults = (*other_bits(counts), *beyond_proof(same.proof))
    else:
        bits = None
        faults = (*single.faults, *_far(subject, single.measured), *_far(subject, slopes))
    beginning = {name: values[:FREE_STEPS] for name, values in free.items()}
    return Agreement(
        target=subject.target,
        dtype=subject.dtype,
        steps=same.steps,
        one_step=None
        if loaded.step is None
        else max(single.measured.deviations.values(), default=0.0),
        free_run=worst_deviation(beginning, wanted.outputs),
        jacobian=None
        if exact or exported is None
        else max(slopes.deviations.values(), default=0.0),
        bits=bits,
        faults=faults,
        undecided={**single.undecided, **slopes.undecided},
        untried=single.untried,
        rounding=_costly(subject, wanted, single.costs),
    )


def _free_run(loaded: Loaded, judged: Judgement, most_steps: int) -> Arrays:
    steps = min(judged.steps, most_steps)
    inputs = {name: values[:steps] for name, values in judged.inputs.items()}
    return loaded.run(judged.beginning, inputs, steps)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Single:
    """The errors of initial states and of single steps of an export."""

    measured: Deviations
    costs: Mapping[str, float]
    """Errors of the interpreter in single precision, over all steps."""
    undecided: Mapping[str, int]
    untried: tuple[str, ...] = ()
    faults: tuple[Fault, ...] = ()


def _start_and_steps(
    subject: Subject,
    loaded: Loaded,
    beginning: Beginning,
    wanted: Judgement,
    record: AgreementRecord,
) -> _Single:
    """Compares initial states, and single steps from reference states."""
    if loaded.step is None or loaded.start is None:
        return _Single(measured=NOTHING, costs={}, undecided={})
    # each step from the judge's state: errors do not add up
    found = labelled(*loaded.step(wanted.inputs, wanted.states, wanted.steps))
    found |= labelled_first(loaded.start(beginning))
    single = single_steps(subject.program, subject.weights, record, wanted)
    first = first_states(subject.program, subject.weights, record)
    following = single["next_states"]
    if subject.restarts:
        # code that promises bits decides as its own arithmetic does, other code as the judge
        at = outside(subject.program, following, np.float32)
        if not subject.is_exact:
            at = wanted.restarted
        following = begun_again(following, at, first)
    rounded = labelled(single["outputs"], following) | labelled_first(first)
    judged = labelled(wanted.outputs, wanted.next_states) | labelled_first(wanted.states)
    costs = deviations(rounded, judged)
    if subject.is_exact:
        # what promises bits is compared with the judge of its own arithmetic
        measured = Deviations(deviations(found, judged), costs, bits_of_each(found, rounded))
        return _Single(measured=measured, costs=costs, undecided={})
    dtype = "float32" if subject.dtype == "float32" else "float64"
    open_steps = branches(subject, dtype, record, wanted, found)
    settled = open_steps.settled(found, judged)
    deviated = deviations(settled, judged)
    errors = deviations(open_steps.settled(rounded, judged), judged)
    undecided, untried = open_steps.counts, list(open_steps.untried)
    far = {fault.of for fault in _far(subject, Deviations(deviated, errors, {}))}
    # a bound for each value costs another run: only of values that are too far by the simple
    # measure
    if far and dtype == "float64":
        doubted = {name: values for name, values in settled.items() if name in far}
        inside = within_rounding(subject.program, subject.weights, record, wanted, doubted)
        # inside its bound a value is as right as float64 can be
        deviated |= dict.fromkeys(inside, 0.0)
        for name, unbounded in inside.items():
            every = unbounded | open_steps.at[name]
            undecided |= {name: int(every.sum())} if every.any() else {}
            untried += [name] if every.all() and name not in untried else []
    measured = Deviations(deviated, errors, {})
    return _Single(
        measured=measured,
        costs=costs,
        undecided=undecided,
        untried=tuple(untried),
        faults=open_steps.faults,
    )


def _far(subject: Subject, measured: Deviations) -> tuple[Fault, ...]:
    """Faults of values whose error exceeds the effect of rounding."""
    found = measured.deviations
    limits = {name: step_limit(subject.dtype, measured.rounding[name]) for name in found}
    return tuple(
        FarStep(name, deviation, limits[name])
        for name, deviation in found.items()
        # written so that NaN is far
        if not deviation <= limits[name]
    )


def _costly(subject: Subject, wanted: Judgement, errors: Mapping[str, float]) -> dict[str, float]:
    """Outputs that float32 computes with large errors even in the interpreter; only for float32
    exports.
    """
    if subject.dtype != "float32":
        return {}
    outputs = {name: errors[name] for name in labelled(wanted.outputs, {}) if name in errors}
    return {n: error for n, error in outputs.items() if not error <= STEP_LIMIT[subject.dtype]}
