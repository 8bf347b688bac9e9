"""Loads the files that an export wrote and runs them, without the program that they came from."""

from __future__ import annotations

import importlib.util
import json
import sys
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from msnn.agreement.judge import Arrays
from msnn.errors.failures import MissingExtraError


class Artefact(Protocol):
    """An exported step with explicit states."""

    def start(self, windows: Arrays) -> Arrays:
        """The states before the first step, (1, *shape) each, from windows (*shape)."""
        ...

    def step(self, inputs: Arrays, states: Arrays, steps: int) -> tuple[Arrays, Arrays]:
        """Outputs and next states of steps side by side; all arrays are (steps, *shape)."""
        ...


class TorchArtefact:
    """The module in `<prefix>.py` with the weights beside it."""

    def __init__(self, folder: Path, prefix: str) -> None:
        path = folder / f"{prefix}.py"
        spec = importlib.util.spec_from_file_location(f"exported_{prefix}", path)
        assert spec is not None, "a path that ends in .py has a loader"
        assert spec.loader is not None
        module: Any = importlib.util.module_from_spec(spec)
        with _no_bytecode():
            spec.loader.exec_module(module)
        self._model: Any = module.load()

    def start(self, windows: Arrays) -> Arrays:
        given = {name: value[np.newaxis] for name, value in windows.items()}
        return self._arrays(self._model.initial_state(self._tensors(given)))

    def step(self, inputs: Arrays, states: Arrays, steps: int) -> tuple[Arrays, Arrays]:
        del steps  # the module takes it from its tensors
        outputs, following = self._model(self._tensors(inputs), self._tensors(states))
        return self._arrays(outputs), self._arrays(following)

    def _tensors(self, arrays: Arrays) -> dict[str, Any]:
        torch: Any = import_module("torch")
        own = next((p.dtype for p in self._model.parameters()), torch.float64)
        return {name: torch.tensor(value, dtype=own) for name, value in arrays.items()}

    @staticmethod
    def _arrays(tensors: Mapping[str, Any]) -> Arrays:
        return {name: value.detach().numpy() for name, value in tensors.items()}


@contextmanager
def _no_bytecode() -> Generator[None]:
    """Keeps Python from writing `__pycache__` into the folder of an export."""
    before, sys.dont_write_bytecode = sys.dont_write_bytecode, True
    try:
        yield
    finally:
        sys.dont_write_bytecode = before


class CasadiArtefact:
    """The functions in `<prefix>.casadi` and `<prefix>_initial_state.casadi`, as `<prefix>.json`
    describes them."""

    def __init__(self, folder: Path, prefix: str) -> None:
        import casadi

        self._about = json.loads((folder / f"{prefix}.json").read_text(encoding="utf-8"))
        self._step: Any = casadi.Function.load(str(folder / f"{prefix}.casadi"))
        self._start: Any = casadi.Function.load(str(folder / f"{prefix}_initial_state.casadi"))
        self._parameters = {
            entry["port"]: np.array(entry["values"]) for entry in self._about["parameters"]
        }

    def start(self, windows: Arrays) -> Arrays:
        given = {e["port"]: windows[e["name"]].ravel() for e in self._about["start_windows"]}
        values = self._call(self._start, given)
        return {e["name"]: _shaped(values[e["port"]], e)[None] for e in self._about["states"]}

    def step(self, inputs: Arrays, states: Arrays, steps: int) -> tuple[Arrays, Arrays]:
        outputs: list[Arrays] = []
        following: list[Arrays] = []
        for k in range(steps):
            given = {e["port"]: inputs[e["name"]][k].ravel() for e in self._about["inputs"]}
            given |= {e["port"]: states[e["name"]][k].ravel() for e in self._about["states"]}
            values = self._call(self._step, given)
            outputs.append(
                {e["name"]: _shaped(values[e["port"]], e) for e in self._about["outputs"]}
            )
            following.append(
                {e["name"]: _shaped(values[e["next_port"]], e) for e in self._about["states"]}
            )
        return _stacked(outputs), _stacked(following)

    def _call(self, function: Any, given: Arrays) -> Arrays:
        known = set(function.name_in())
        arguments = {n: v for n, v in (given | self._parameters).items() if n in known}
        return {name: np.array(value) for name, value in function.call(arguments).items()}


class OnnxArtefact:
    """The models `<prefix>.onnx` and `<prefix>_initial_state.onnx`, in onnxruntime."""

    def __init__(self, folder: Path, prefix: str, names: Mapping[str, Mapping[str, str]]) -> None:
        if importlib.util.find_spec("onnxruntime") is None:
            install = "pip install 'msnn[onnxruntime]'"
            raise MissingExtraError("onnxruntime, which runs ONNX models,", install)
        self._names = names
        self._step = _session(folder / f"{prefix}.onnx")
        first = folder / f"{prefix}_initial_state.onnx"
        self._start = _session(first) if first.is_file() else None

    def start(self, windows: Arrays) -> Arrays:
        if self._start is None:
            return {}
        given = {port: windows[name] for name, port in self._names["start_windows"].items()}
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
        return _stacked(outputs), _stacked(following)


def _session(path: Path) -> Any:
    onnxruntime: Any = import_module("onnxruntime")
    options = onnxruntime.SessionOptions()
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


def _shaped(column: NDArray[Any], entry: Mapping[str, Any]) -> NDArray[Any]:
    return column.ravel().reshape([axis["size"] for axis in entry["axes"]])


def _stacked(steps: list[Arrays]) -> Arrays:
    return {name: np.stack([step[name] for step in steps]) for name in steps[0]}
