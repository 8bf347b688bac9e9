"""L-BFGS of torch steps as it does in torch, without what it does for torch's compiler."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import torch

from msnn.training.engines.torch.plain_lbfgs import PlainLbfgs

NO_COMPILER = """
import sys
from msnn.training.engines.torch.plain_lbfgs import PlainLbfgs
from tests.training.engines.test_plain_lbfgs import steps
steps(PlainLbfgs)
assert "torch._dynamo" not in sys.modules, "torch's compiler is imported"
"""


def steps(made: Any) -> list[float]:
    """Where three steps lead, with the state saved and read back between them."""
    variable = torch.nn.Parameter(torch.tensor([1.5, -0.5, 2.0], dtype=torch.float64))
    optimizer = made([variable], lr=1.0, max_iter=4, line_search_fn="strong_wolfe")

    def closure() -> torch.Tensor:
        variable.grad = None
        total = (variable - 1).pow(4).sum() + variable.prod()
        total.backward()  # pyright: ignore[reportUnknownMemberType]
        return total

    for _ in range(3):
        optimizer.step(closure)
        kept = optimizer.state_dict()
        optimizer = made([variable], lr=1.0, max_iter=4, line_search_fn="strong_wolfe")
        optimizer.load_state_dict(kept)
    return variable.tolist()


def test_the_steps_are_those_of_torch_to_the_bit():
    assert steps(PlainLbfgs) == steps(torch.optim.LBFGS)


def test_it_does_not_import_the_compiler_of_torch():
    """It has 900 modules, which take 1.7 seconds of a processor."""
    subprocess.run([sys.executable, "-c", NO_COMPILER], check=True)
