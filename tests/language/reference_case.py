"""Reference cases: a spec with a log and the exact values it must have, run in every backend.

A case is one file `tests/language/cases/SUBJECT/NAME.yaml`, the subject a layer or a part of
the language: a whole spec, and the key `x-case`, which the product leaves to other tools.
`test_reference_cases.py` runs every file there.

    x-case:
      source: where the expected values come from
      log: {x: [1, 2, 3]}            # one row a sample; a vector signal has a list in each row
      weights: {h.weight: [1, 10]}   # parameters by name; what is missing keeps its initial value
      start: 2                       # row of the first step, by default the first that is possible
      tolerance: 1e-12               # relative to the largest magnitude of each output
      expected:                      # values of the outputs at steps start, start+1, …
        y: [21, 32]

States run freely from `start`, so that integrals and integrators have their cases too. Outputs
that are not listed are computed and not compared.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import torch
import yaml
from numpy.typing import DTypeLike, NDArray

from backends.native.kernel import Kernel
from backends.torch_module.module import build_module
from compiler.elaboration.compile import compile_spec
from compiler.interpreter.interpreter import Interpreter, physical_weights
from compiler.ir.builder import GraphBuilder
from compiler.ir.program import Loss, Measure, Program
from compiler.ir.types import Axis
from compiler.passes.to_step_form import to_step_form
from msnn.agreement.judge import judge
from msnn.agreement.judgement import AgreementRecord, FloatType
from msnn.data.rollout_rows import reach
from msnn.exports.export import load_export, write_export
from msnn.simulation.engines.engine import EngineName
from spec_schema.reading.reader import read_spec
from tests.agreement.exported import plan_of
from tests.every_op.agreement import assert_agrees, assert_same_bits

Arrays = Mapping[str, NDArray[Any]]

CASES = Path(__file__).parent / "cases"

SINGLE = 1e-5
"""The promise for one step in float32; the cases are short and stable."""


@dataclass(frozen=True)
class Case:
    """A program with a log and what its outputs are, (steps, *shape) each."""

    program: Program
    log: dict[str, NDArray[np.float64]]
    weights: dict[str, NDArray[np.float64]]
    start: int
    steps: int
    expected: dict[str, NDArray[np.float64]]
    tolerance: float


@lru_cache(maxsize=4)  # each goes through all backends, one after the other
def read_case(path: Path) -> Case:
    """The case of a file."""
    text = path.read_text(encoding="utf-8")
    given = yaml.load(text, Loader=yaml.CSafeLoader)["x-case"]
    read = read_spec(path, text)
    program = replace(compile_spec(read.spec, used=read.used).program, losses=())
    expected = _arrays(given["expected"])
    far = reach(replace(program, outputs=tuple(replace(o, predicts=None) for o in program.outputs)))
    return Case(
        program,
        _arrays(given.get("log", {})),
        physical_weights(program, _arrays(given.get("weights", {}))),
        int(given.get("start", far.back)),
        len(next(iter(expected.values()))),
        expected,
        float(given.get("tolerance", 1e-12)),
    )


def assert_case(case: Case, backend: str) -> None:
    """The backend computes what the case expects, C in float32 with the bits of its judge."""
    run, limit = BACKENDS[backend]
    found = run(case)
    if backend == "c32":
        bits = _interpreter(np.float32)(case)
        for name in case.expected:
            assert_same_bits(np.asarray(found[name]), bits[name], name)
    for name, expected in case.expected.items():
        actual = np.asarray(found[name])
        assert_agrees(actual, expected, max(limit, case.tolerance), f"{backend} {name}")


def _arrays(lists: Mapping[str, Any]) -> dict[str, NDArray[np.float64]]:
    return {name: np.array(values, dtype=np.float64) for name, values in lists.items()}


# ---- one run in each backend


def _interpreter(dtype: DTypeLike) -> Callable[[Case], Arrays]:
    def run(case: Case) -> Arrays:
        log = {name: series.astype(dtype) for name, series in case.log.items()}
        judge = Interpreter(case.program, case.weights, dtype)
        found = judge.rollout(log, case.start, case.steps).outputs
        return {name: values[0] for name, values in found.items()}

    return run


def _torch(case: Case) -> Arrays:
    module = build_module(case.program, torch.float64)
    module.load_physical(case.weights)
    log = {name: torch.from_numpy(series) for name, series in case.log.items()}
    t = torch.tensor([case.start])
    with torch.no_grad():
        states = module.start(log, t)
        steps: list[Arrays] = []
        for k in range(case.steps):
            values = module.step(log, t + k, states)
            states = values.next_states
            steps.append({name: value.numpy() for name, value in values.outputs.items()})
    return _joined(steps)


def _exported(target: str, dtype: FloatType) -> Callable[[Case], Arrays]:
    def run(case: Case) -> Arrays:
        plan = plan_of(target, to_step_form(case.program), dtype)
        record = AgreementRecord(case.log, case.start, case.steps, "the case")
        given = judge(plan.program, case.weights, record, dtype)
        with TemporaryDirectory(prefix="reference_case_") as folder:
            written = write_export(plan, case.weights, Path(folder))
            with load_export(plan, written) as loaded:
                return loaded.run(given.beginning, given.inputs, case.steps)

    return run


def _joined(steps: list[Arrays]) -> Arrays:
    return {name: np.concatenate([step[name] for step in steps]) for name in steps[0]}


def _native(case: Case) -> Arrays:
    """Training kernels give losses only: each element of an output is one, scored at one step."""
    builder = GraphBuilder(case.program.step)
    losses: list[Loss] = []
    for name in case.expected:
        node = case.program.output(name).node
        elements = Axis("element", builder.type(node).size)
        flat = builder.reshape(node, (elements,))
        for index in range(elements.size):
            element = builder.element(flat, elements.name, index)
            losses.append(Loss(f"{name}[{index}]", Measure.MEAN, element, None))
    program = replace(case.program, step=builder.graph(), losses=tuple(losses))
    kernel = Kernel(program, "float64")
    physical = [case.weights[parameter.name].ravel() for parameter in program.parameters]
    flat_weights = np.concatenate([np.zeros(0), *physical])
    scale = [0.0] * len(losses)
    steps: list[NDArray[np.float64]] = []
    for k in range(case.steps):
        groups = kernel.groups(np.array([case.start]), np.array([k + 1]))
        found = kernel.losses(kernel.data(case.log, k), groups, flat_weights, scale, gradient=False)
        steps.append(found.sums)
    values = dict(zip(kernel.source.losses, np.array(steps).T, strict=True))
    return {
        name: np.stack(
            [values[f"{name}[{index}]"] for index in range(max(1, expected[0].size))], axis=-1
        ).reshape(expected.shape)
        for name, expected in case.expected.items()
    }


ENGINES: dict[EngineName, dict[str, tuple[Callable[[Case], Arrays], float]]] = {
    "interpreter": {
        "judge": (_interpreter(np.float64), 0.0),
        "judge32": (_interpreter(np.float32), SINGLE),
    },
    "torch": {"torch": (_torch, 0.0)},
    "native": {"native": (_native, 0.0)},
}
"""What runs the cases inside the product, by the engine's name; tolerances as in `BACKENDS`."""

EXPORTS: dict[str, tuple[str, FloatType]] = {
    "torch export": ("torch", "float64"),
    "casadi": ("casadi", "float64"),
    "onnx": ("onnx", "float64"),
    "c": ("c", "float64"),
    "c32": ("c", "float32"),
}
"""What runs what was exported: the target and its numbers. An `fmu` holds the C that runs here."""

BACKENDS: dict[str, tuple[Callable[[Case], Arrays], float]] = {
    **{name: run for engine in ENGINES.values() for name, run in engine.items()},
    **{
        name: (_exported(target, dtype), 0.0 if dtype == "float64" else SINGLE)
        for name, (target, dtype) in EXPORTS.items()
    },
}
"""Each backend and the tolerance that its arithmetic needs whatever the case says."""
