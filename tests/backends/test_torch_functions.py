"""Scalar functions that torch lacks are written out in those that it has."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from backends.torch_module import lowering
from backends.torch_module.module import build_module
from backends.torch_module.source import torch_source
from compiler.passes.to_step_form import to_step_form
from tests.language.compiled import compiled


def test_a_function_that_torch_lacks_is_written_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lowering, "NATIVE_FUNCTIONS", lowering.NATIVE_FUNCTIONS - {"tan"})
    program = compiled("inputs: {x: rad}\noutputs: {y: tan(x)}")
    x = np.array([0.1, -0.4, 1.2])
    module = build_module(program)
    log, rows = {"x": torch.from_numpy(x)}, torch.arange(3)
    found = module.step(log, rows, module.start(log, rows)).outputs["y"]
    # a quotient of two correctly rounded functions
    np.testing.assert_allclose(found.detach().numpy(), np.tan(x), rtol=1e-15)
    assert "tan(" not in torch_source(to_step_form(program), "m", "float64")
