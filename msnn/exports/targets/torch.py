"""The target `torch`: a module in a Python file, with its weights beside it."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from msnn.agreement.judgement import Arrays, Beginning, Loaded, loaded_by_steps
from msnn.exports.prepare import float_plan
from msnn.exports.target import ExportPlan, Request, Target, Weights, Written
from spec_schema.sections.exports import TorchExport


def _prepare(request: Request, entry: TorchExport | None) -> ExportPlan[None] | None:
    return float_plan(TARGET, request, entry)


def _write(plan: ExportPlan[None], weights: Weights, folder: Path) -> tuple[Path, ...]:
    from backends.torch_module.source import write_torch

    return write_torch(plan.program, weights, folder, plan.prefix, plan.float_type)


@contextmanager
def _load(plan: ExportPlan[None], written: Written) -> Generator[Loaded]:
    exported = _TorchExport(written.folder, plan.prefix)
    yield loaded_by_steps(exported.start, exported.step)


TARGET: Target[TorchExport, None] = Target(
    name="torch",
    entry=TorchExport,
    dtype="float64",
    options=None,
    prepare=_prepare,
    write=_write,
    load=_load,
)


class _TorchExport:
    """Runs the exported module in `<prefix>.py` with the weights next to it."""

    def __init__(self, folder: Path, prefix: str) -> None:
        path = folder / f"{prefix}.py"
        spec = importlib.util.spec_from_file_location(f"exported_{prefix}", path)
        assert spec is not None, "a path that ends in .py has a loader"
        assert spec.loader is not None
        module: Any = importlib.util.module_from_spec(spec)
        with _no_bytecode():
            # what this product has just written, no file of others
            spec.loader.exec_module(module)
        self._model: Any = module.load()

    def start(self, beginning: Beginning) -> Arrays:
        given = {name: value[np.newaxis] for name, value in beginning.windows.items()}
        return self._arrays(self._model.initial_state(self._tensors(given)))

    def step(self, inputs: Arrays, states: Arrays, steps: int) -> tuple[Arrays, Arrays]:
        answers = self._model(self._tensors(inputs), self._tensors(states))
        outputs, following = (self._arrays(tensors) for tensors in answers)
        if not (inputs or states):  # the module takes the number of steps from its tensors
            outputs = {name: np.repeat(value, steps, axis=0) for name, value in outputs.items()}
        return outputs, following

    def _tensors(self, arrays: Arrays) -> dict[str, Any]:
        torch: Any = import_module("torch")
        # a module without parameters computes in whatever it is given
        own = next((p.dtype for p in self._model.parameters()), torch.float64)
        return {name: torch.tensor(value, dtype=own) for name, value in arrays.items()}

    @staticmethod
    def _arrays(tensors: Mapping[str, Any]) -> Arrays:
        return {name: value.detach().numpy() for name, value in tensors.items()}


@contextmanager
def _no_bytecode() -> Generator[None]:
    """A context in which Python writes no `__pycache__` into the folder of an export."""
    before, sys.dont_write_bytecode = sys.dont_write_bytecode, True
    try:
        yield
    finally:
        sys.dont_write_bytecode = before
