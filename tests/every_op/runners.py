"""Runs one step of a program at many rows of a log in every backend, each from its own start."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import casadi
import numpy as np
import onnxruntime
import torch
from numpy.typing import DTypeLike, NDArray

from backends.casadi_function.function import build_function, build_initial_state, casadi_names
from backends.onnx_model.model import build_initial_state as build_onnx_start
from backends.onnx_model.model import build_model, onnx_names
from backends.ports.step_interface import Port, step_interface
from backends.torch_module.module import build_module
from compiler.interpreter.interpreter import Interpreter
from compiler.ir.program import Program
from compiler.passes.to_step_form import to_step_form

Log = Mapping[str, NDArray[np.float64]]


@dataclass(frozen=True)
class Result:
    """Arrays (times, *shape) by name."""

    outputs: dict[str, NDArray[Any]]
    next_states: dict[str, NDArray[Any]]


Runner = Callable[[Program, Log, NDArray[np.int64]], Result]


def run_interpreter(dtype: DTypeLike) -> Runner:
    def run(program: Program, log: Log, times: NDArray[np.int64]) -> Result:
        judge = Interpreter(program, dtype=dtype)
        values = judge.step(log, times, judge.start(log, times))
        return Result(values.outputs, values.next_states)

    return run


def run_torch(dtype: torch.dtype) -> Runner:
    def run(program: Program, log: Log, times: NDArray[np.int64]) -> Result:
        module = build_module(program, dtype)
        tensors = {name: torch.tensor(series, dtype=dtype) for name, series in log.items()}
        t = torch.tensor(times)
        with torch.no_grad():
            values = module.step(tensors, t, module.start(tensors, t))
        return Result(_as_arrays(values.outputs), _as_arrays(values.next_states))

    return run


def run_casadi(program: Program, log: Log, times: NDArray[np.int64]) -> Result:
    program = to_step_form(program)
    interface, names = step_interface(program), casadi_names(program)
    step, start = build_function(program), build_initial_state(program)
    weights = {
        names.parameters[p.name]: np.array(p.initial)
        for p in (*interface.parameters, *interface.start_parameters)
    }
    results: list[Result] = []
    for t in times.tolist():
        windows = _port_values(interface.start_windows, names.start_windows, log, t)
        states = _call(start, {**windows, **weights})
        inputs = _port_values(interface.inputs, names.inputs, log, t)
        values = _call(step, {**inputs, **states, **weights})
        outputs = {
            o.name: values[names.outputs[o.name]].reshape(program.step[o.node].type.shape)
            for o in interface.outputs
        }
        next_states = {
            s.name: values[names.next_states[s.name]].reshape([axis.size for axis in s.axes])
            for s in interface.states
        }
        results.append(Result(outputs, next_states))
    return together(results)


def run_onnx(dtype: DTypeLike) -> Runner:
    def run(program: Program, log: Log, times: NDArray[np.int64]) -> Result:
        program = to_step_form(program)
        interface, names = step_interface(program), onnx_names(program)
        step = _session(build_model(program, dtype=dtype))
        start = _session(build_onnx_start(program, dtype=dtype)) if program.states else None
        results: list[Result] = []
        for t in times.tolist():
            windows = _port_values(interface.start_windows, names.start_windows, log, t)
            states = _infer(start, windows, dtype) if start else {}
            inputs = _port_values(interface.inputs, names.inputs, log, t)
            values = _infer(step, {**inputs, **states}, dtype)
            results.append(
                Result(
                    {name: values[port] for name, port in names.outputs.items()},
                    {name: values[port] for name, port in names.next_states.items()},
                )
            )
        return together(results)

    return run


def _port_values(
    ports: tuple[Port, ...], names: Mapping[str, str], log: Log, t: int
) -> dict[str, NDArray[np.float64]]:
    values: dict[str, NDArray[np.float64]] = {}
    for port in ports:
        rows = log[port.signal.name][t + port.first : t + port.last + 1]
        values[names[port.signal.name]] = np.moveaxis(rows, 0, -1).reshape(port.type.shape)
    return values


def _call(
    function: casadi.Function, values: Mapping[str, NDArray[np.float64]]
) -> dict[str, NDArray[np.float64]]:
    known = set(function.name_in())
    columns = {name: value.ravel() for name, value in values.items() if name in known}
    return {name: np.array(value).ravel() for name, value in function.call(columns).items()}


def _session(model: Any) -> onnxruntime.InferenceSession:
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    return onnxruntime.InferenceSession(
        model.SerializeToString(), options, providers=["CPUExecutionProvider"]
    )


def _infer(
    session: onnxruntime.InferenceSession, values: Mapping[str, NDArray[Any]], dtype: DTypeLike
) -> dict[str, NDArray[Any]]:
    names = [result.name for result in session.get_outputs()]
    known = {value.name for value in session.get_inputs()}
    feeds = {name: np.asarray(v, dtype) for name, v in values.items() if name in known}
    return {n: np.asarray(v) for n, v in zip(names, session.run(names, feeds), strict=True)}


def together(results: list[Result]) -> Result:
    """The results of single rows as one of all rows."""
    first = results[0]
    return Result(
        {name: np.stack([r.outputs[name] for r in results]) for name in first.outputs},
        {name: np.stack([r.next_states[name] for r in results]) for name in first.next_states},
    )


def _as_arrays(tensors: Mapping[str, torch.Tensor]) -> dict[str, NDArray[Any]]:
    return {name: tensor.numpy() for name, tensor in tensors.items()}
