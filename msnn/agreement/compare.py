"""Compares every written export with the judge: one step from its states, a free run, and bits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import assert_never

import numpy as np

from compiler.jacobian.interpret import JacobianInterpreter
from msnn.agreement.artefacts import Artefact, CasadiArtefact, OnnxArtefact, TorchArtefact
from msnn.agreement.c_artefact import CModel, built_c
from msnn.agreement.deviation import bits_of_each, deviations, worst_deviation
from msnn.agreement.judge import Arrays, Judgement, judge
from msnn.agreement.judged_words import judged_words
from msnn.agreement.record import Record
from msnn.agreement.rounding import (
    STEP_LIMIT,
    labelled,
    rounding_errors,
    single_steps,
    step_limit,
    within_rounding,
)
from msnn.data.dataset import FloatArray
from msnn.exports.export import ExportPlan, FixedPoint

FREE_STEPS = 1000
LINEARIZED_STEPS = 200


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
    """The worst of all steps, each from the judge's state; None for C in fixed point."""
    free_run: float
    """The worst of a free run of at most 1,000 steps; grows where the model is unstable."""
    bits: int | None
    """Values whose bits differ from the judge's in the same arithmetic; for C in float32 and in
    fixed point, whose judge is the integer interpreter."""
    faults: tuple[Fault, ...]
    """Where the target breaks its promise: of bits where it has one, else of near numbers."""
    rounding: dict[str, float]
    """What single precision costs the interpreter itself, of outputs where that is much."""

    @property
    def agrees(self) -> bool:
        """Whether the target keeps what it promises."""
        return not self.faults


def compare(
    plan: ExportPlan,
    weights: Mapping[str, FloatArray],
    files: Sequence[Path],
    folder: Path,
    record: Record,
) -> Agreement:
    """Runs the `files` that `write_export` wrote into `folder` along the record.

    Raises MissingExtraError where onnxruntime or a C compiler is needed and not there.
    """
    match plan.target:
        case "torch":
            return _explicit(plan, weights, record, TorchArtefact(folder, plan.prefix))
        case "casadi":
            return _explicit(plan, weights, record, CasadiArtefact(folder, plan.prefix))
        case "onnx":
            from backends.onnx_model.model import onnx_names

            names = onnx_names(plan.program)
            tables = {
                "inputs": names.inputs,
                "states": names.states,
                "outputs": names.outputs,
                "next_states": names.next_states,
                "start_windows": names.start_windows,
            }
            artefact = OnnxArtefact(folder, plan.prefix, tables)
            return _explicit(plan, weights, record, artefact)
        case "c" if plan.fixed_point is not None:
            return _fixed_point(plan, plan.fixed_point, weights, record, files, folder)
        case "c":
            return _c(plan, weights, record, files, folder)
        case _:
            assert_never(plan.target)


def _explicit(
    plan: ExportPlan, weights: Mapping[str, FloatArray], record: Record, artefact: Artefact
) -> Agreement:
    wanted = judge(plan.program, weights, record, np.float64)
    outputs, following = artefact.step(wanted.inputs, wanted.states, record.steps)
    found = deviations(labelled(outputs, following), labelled(wanted.outputs, wanted.next_states))
    errors = rounding_errors(single_steps(plan.program, weights, record, wanted), wanted)
    far = {fault.of for fault in _far(plan, found, errors)}
    if far and plan.dtype == "float64":
        values = labelled(outputs, following)
        doubted = {name: value for name, value in values.items() if name in far}
        inside = within_rounding(plan.program, weights, record, wanted, doubted)
        found |= dict.fromkeys(inside, 0.0)
    free = worst_deviation(_free_run(artefact, wanted, record), wanted.outputs)
    return Agreement(
        target=plan.target,
        dtype=plan.dtype,
        steps=record.steps,
        one_step=max(found.values(), default=0.0),
        free_run=free,
        bits=None,
        faults=_far(plan, found, errors),
        rounding=_costly(plan, wanted, errors),
    )


def _far(
    plan: ExportPlan, found: Mapping[str, float], errors: Mapping[str, float]
) -> tuple[Fault, ...]:
    """The values that are farther from the judge than rounding explains."""
    limits = {name: step_limit(plan.dtype, errors.get(name, 0.0)) for name in found}
    return tuple(
        Fault(name, deviation, limits[name], None)
        for name, deviation in found.items()
        if not deviation <= limits[name]
    )


def _different(counts: Mapping[str, int]) -> tuple[Fault, ...]:
    return tuple(Fault(name, None, None, count) for name, count in counts.items() if count)


def _costly(plan: ExportPlan, wanted: Judgement, errors: Mapping[str, float]) -> dict[str, float]:
    if plan.dtype != "float32":
        return {}
    outputs = {name: errors[name] for name in labelled(wanted.outputs, {})}
    return {n: error for n, error in outputs.items() if not error <= STEP_LIMIT[plan.dtype]}


def _slopes(
    model: CModel,
    plan: ExportPlan,
    weights: Mapping[str, FloatArray],
    record: Record,
    judged: Judgement,
    steps: int,
) -> Arrays:
    """What the interpreter says of the matrices that C has, in its arithmetic."""
    interface = model.interface.jacobian
    if interface is None:
        return {}
    log = {name: series.astype(plan.dtype) for name, series in record.log.items()}
    states = {name: values[:steps] for name, values in judged.states.items()}
    own = JacobianInterpreter(interface.jacobian, plan.program, weights, plan.dtype)
    found = own.matrices(log, record.t0 + np.arange(steps), states)
    return {field.matrix.name: found[field.matrix.name] for field in interface.fields}


def _free_run(artefact: Artefact, wanted: Judgement, record: Record) -> Arrays:
    states = artefact.start(wanted.windows)
    steps: list[Arrays] = []
    for k in range(min(record.steps, FREE_STEPS)):
        inputs = {name: values[k : k + 1] for name, values in wanted.inputs.items()}
        outputs, states = artefact.step(inputs, states, 1)
        steps.append(outputs)
    return {name: np.concatenate([step[name] for step in steps]) for name in steps[0]}


def _fixed_point(
    plan: ExportPlan,
    format: FixedPoint,
    weights: Mapping[str, FloatArray],
    record: Record,
    files: Sequence[Path],
    folder: Path,
) -> Agreement:
    """A free run of words: bits against the integer interpreter, numbers against float64."""
    wanted = judge(plan.program, weights, record, np.float64)
    words = judged_words(plan.program, weights, format, wanted, FREE_STEPS)
    with built_c(files, folder, plan) as model:
        model.step.reset(words.windows)
        found, _ = model.step.run(words.inputs, words.steps)
    counts = {f"`{n}`": int(np.sum(found[n] != values)) for n, values in words.outputs.items()}
    return Agreement(
        target=plan.target,
        dtype=format,
        steps=words.steps,
        one_step=None,
        free_run=worst_deviation(words.real(found), wanted.outputs),
        bits=sum(counts.values()),
        faults=_different(counts),
        rounding={},
    )


def _c(
    plan: ExportPlan,
    weights: Mapping[str, FloatArray],
    record: Record,
    files: Sequence[Path],
    folder: Path,
) -> Agreement:
    """Each step from the judge's states, and a free run; in float32 against the bits of both.

    What C in float32 promises are the bits of the interpreter in float32: how far these are from
    float64 is a property of the model, which is told and not judged.
    """
    wanted = judge(plan.program, weights, record, np.float64)
    same = wanted if plan.dtype == "float64" else judge(plan.program, weights, record, np.float32)
    with built_c(files, folder, plan) as model:
        model.reset(same)
        free, _ = model.step.run(same.inputs, record.steps)
        outputs, following = model.steps(wanted)
        compared = min(record.steps, LINEARIZED_STEPS)
        slopes = model.slopes(same, compared)
        expected = _slopes(model, plan, weights, record, same, compared)
    single = single_steps(plan.program, weights, record, wanted)
    errors = rounding_errors(single, wanted)
    near = deviations(labelled(outputs, following), labelled(wanted.outputs, wanted.next_states))
    beginning = {name: values[:FREE_STEPS] for name, values in free.items()}
    deviation = worst_deviation(beginning, wanted.outputs)
    if plan.dtype == "float64":
        near |= {f"the matrix {name}": d for name, d in deviations(slopes, expected).items()}
        bits, faults = None, _far(plan, near, errors)
    else:
        counts = bits_of_each(
            labelled(outputs, following), labelled(single["outputs"], single["next_states"])
        )
        for name, count in bits_of_each(free, same.outputs).items():
            counts[f"`{name}`"] += count
        matrices = bits_of_each(slopes, expected)
        counts |= {f"the matrix {name}": count for name, count in matrices.items()}
        bits, faults = sum(counts.values()), _different(counts)
    return Agreement(
        target=plan.target,
        dtype=plan.dtype,
        steps=record.steps,
        one_step=max(near.values(), default=0.0),
        free_run=deviation,
        bits=bits,
        faults=faults,
        rounding=_costly(plan, wanted, errors),
    )
