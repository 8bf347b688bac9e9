"""The target `onnx`: models of a step, of many steps and of the first states."""

from __future__ import annotations

from collections.abc import Generator, Mapping
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from msnn.agreement.judgement import Arrays, Beginning, Loaded, loaded_by_steps, stacked
from msnn.exports.prepare import float_plan
from msnn.exports.target import ExportPlan, Request, Target, Weights, Written
from spec_schema.sections.exports import OnnxExport


def _prepare(request: Request, entry: OnnxExport | None) -> ExportPlan[None] | None:
    return float_plan(TARGET, request, entry)


def _write(plan: ExportPlan[None], weights: Weights, folder: Path) -> tuple[Path, ...]:
    from backends.onnx_model.model import write_onnx

    return write_onnx(plan.program, weights, folder, plan.prefix, plan.float_type)


@contextmanager
def _load(plan: ExportPlan[None], written: Written) -> Generator[Loaded]:
    from backends.onnx_model.model import onnx_names

    names = onnx_names(plan.program)
    tables = {
        "inputs": names.inputs,
        "states": names.states,
        "outputs": names.outputs,
        "next_states": names.next_states,
        "start_windows": names.start_windows,
    }
    exported = _OnnxExport(written.folder, plan.prefix, tables)
    yield loaded_by_steps(exported.start, exported.step)


TARGET: Target[OnnxExport, None] = Target(
    name="onnx",
    entry=OnnxExport,
    dtype="float64",
    options=None,
    prepare=_prepare,
    write=_write,
    load=_load,
)


class _OnnxExport:
    """Runs the exported models `<prefix>.onnx` and `<prefix>_initial_state.onnx` in onnxruntime."""

    def __init__(self, folder: Path, prefix: str, names: Mapping[str, Mapping[str, str]]) -> None:
        self._names = names
        self._step = _session(folder / f"{prefix}.onnx")
        first = folder / f"{prefix}_initial_state.onnx"
        self._start = _session(first) if first.is_file() else None

    def start(self, beginning: Beginning) -> Arrays:
        # a model without states has no first ones
        if self._start is None:
            return {}
        ports = self._names["start_windows"]
        given = {port: beginning.windows[name] for name, port in ports.items()}
        values = _infer(self._start, given)
        return {name: values[port][None] for name, port in self._names["states"].items()}

    def step(self, inputs: Arrays, states: Arrays, steps: int) -> tuple[Arrays, Arrays]:
        outputs: list[Arrays] = []
        following: list[Arrays] = []
        for k in range(steps):
            given = {port: inputs[name][k] for name, port in self._names["inputs"].items()}
            given |= {port: states[name][k] for name, port in self._names["states"].items()}
            values = _infer(self._step, given)
            outputs.append({n: values[port] for n, port in self._names["outputs"].items()})
            following.append({n: values[port] for n, port in self._names["next_states"].items()})
        return stacked(outputs), stacked(following)


def _session(path: Path) -> Any:
    onnxruntime: Any = import_module("onnxruntime")
    options = onnxruntime.SessionOptions()
    # the order of sums, and so their bits, does not depend on the machine's cores
    options.intra_op_num_threads = 1
    return onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])


_REALS = {"tensor(float)": np.float32, "tensor(double)": np.float64}


def _infer(session: Any, given: Arrays) -> Arrays:
    names = [result.name for result in session.get_outputs()]
    feeds = {
        value.name: np.asarray(given[value.name], _REALS[value.type])
        for value in session.get_inputs()
    }
    return dict(zip(names, map(np.asarray, session.run(names, feeds)), strict=True))
