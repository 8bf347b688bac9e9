"""Kernels of losses without slopes: the same numbers, and built where nobody asks for slopes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from backends.native import kernel as kernel_module
from backends.native import rollout_kernel
from backends.native.compile_kernel import Built
from backends.native.kernel import Kernel
from backends.native.variables import flat
from compiler.passes.close_loop import close_loop
from msnn.training.train import TrainingOptions, train
from tests.conditions import require_tool
from tests.language.compiled import compiled
from tests.native.test_kernel import MODELS, initial, log_of
from tests.training.cases import dataset, gain, gain_series


@pytest.fixture(autouse=True)
def _compiler() -> None:
    require_tool("gcc", install="apt install gcc")


@pytest.mark.parametrize("name", MODELS)
def test_losses_have_the_same_bits_without_slopes(name: str) -> None:
    text, closed = MODELS[name]
    program = close_loop(compiled(text), closed)
    starts, log, physical = np.arange(10, 50), log_of(program), flat(program, initial(program))
    found: list[bytes] = []
    for slopes in (True, False):
        kernel = Kernel(program, "float64", slopes=slopes)
        groups, every = kernel.groups(starts, 12), [1.0] * len(program.losses)
        one = kernel.losses(kernel.data(log, skip=2), groups, physical, every, gradient=False)
        found.append(one.sums.tobytes() + one.counts.tobytes())
        assert ("msnn_train(" in kernel.source.text) is slopes
    assert found[0] == found[1]


@pytest.mark.parametrize(
    ("stage", "kernels"),
    [
        ("{epochs: 2, batch: 16}", ["training", "slopes"]),
        ("{epochs: 2, optimizer: levenberg_marquardt}", ["slopes", "losses"]),
    ],
)
def test_standard_errors_build_no_kernel_of_losses(
    stage: str, kernels: list[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    built: list[str] = []
    sources: set[tuple[str, bool]] = set()
    right = kernel_module.compiled_kernel

    def noted(source: str, *, on_lanes: bool = False) -> Built:
        kinds = {"msnn_train(": "training", "msnn_products(": "slopes"}
        kind = next((kind for name, kind in kinds.items() if name in source), "losses")
        if (source, on_lanes) not in sources:  # a kernel that is there is not built again
            built.append(kind)
        sources.add((source, on_lanes))
        return right(source, on_lanes=on_lanes)

    monkeypatch.setattr(kernel_module, "compiled_kernel", noted)
    monkeypatch.setattr(rollout_kernel, "compiled_kernel", noted)
    program, spec = gain(f"  - {stage}\n")
    series = dataset(gain_series(150), train=[70], val=[40])
    result = train(program, series, spec.train, TrainingOptions(runs=tmp_path))
    assert result.standard_errors is not None
    assert result.standard_errors.reason is None
    assert built == kernels
