"""Only training imports torch: data, validation and simulation start without it."""

from __future__ import annotations

import subprocess
import sys

import pytest


@pytest.mark.parametrize(
    "module", ["msnn.data.load", "msnn.validation", "msnn.simulation", "msnn.training.stage_plan"]
)
def test_torch_is_not_imported(module: str) -> None:
    script = f"import sys, {module}; assert 'torch' not in sys.modules, 'torch'"
    subprocess.run([sys.executable, "-c", script], check=True)
