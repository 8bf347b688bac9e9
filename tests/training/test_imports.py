"""Only the torch engine imports torch: training in kernels starts without it, as all else does."""

from __future__ import annotations

import subprocess
import sys

import pytest


@pytest.mark.parametrize(
    "module",
    [
        "msnn.data.reading.load",
        "msnn.validation.validate",
        "msnn.simulation.simulate",
        "msnn.training.train",
    ],
)
def test_torch_is_not_imported(module: str) -> None:
    script = f"import sys, {module}; assert 'torch' not in sys.modules, 'torch'"
    subprocess.run([sys.executable, "-c", script], check=True)
