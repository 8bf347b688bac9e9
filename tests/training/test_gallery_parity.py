"""Both engines train every spec of the gallery to the same losses, in one order of starts."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from msnn.api import read_data
from msnn.model_file import load_model
from msnn.training.engine import LossSums
from msnn.training.monitor import loss_values
from msnn.training.native_engine import NativeEngine
from msnn.training.stage_data import stage_data
from msnn.training.stage_plan import plan_stages
from msnn.training.torch_engine import TorchEngine
from msnn.weights_file import initial_weights
from spec_schema.diagnostics import Findings
from tests.conditions import require_tool
from tests.examples.gallery import NAMES, gallery_copy, spec_of

EPOCHS = 3
BATCH = 12
STARTS = 30
"""Three batches, the last one smaller: torch unrolls them step by step."""
TOLERANCES = {"float32": (1e-5, 1e-4), "float64": (1e-12, 1e-9)}
"""Of the first batch's losses at the same weights, and of those of epochs. An error is the small
difference of a prediction and its target and has fewer digits than they: in float32 up to 3e-6 of
a loss is rounding. Steps along rounded gradients add to it."""


@pytest.fixture(scope="module")
def gallery(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return gallery_copy(tmp_path_factory.mktemp("gallery"))


@pytest.mark.parametrize("dtype", TOLERANCES)
@pytest.mark.parametrize("name", NAMES)
def test_both_engines_train_alike(name: str, dtype: str, gallery: Path) -> None:
    require_tool("gcc", install="apt-get install gcc")
    model = load_model(spec_of(gallery, name), [f"train.0.dtype={dtype}"])
    findings = Findings()
    (plan,) = plan_stages(model.program, model.spec.train, findings)
    data = read_data(model, None, "training")
    found = stage_data(plan, data, findings)
    assert found is not None
    runs = found.train.take(np.arange(min(STARTS, len(found.train))))
    begin = initial_weights(model.program)
    sums: list[list[LossSums]] = []
    for make in (NativeEngine, TorchEngine):
        engine = make(plan, data.series, begin, found.train_rows, found.watched_rows)
        sums.append([engine.evaluate(runs.take(np.arange(min(BATCH, len(runs)))))])
        for epoch in range(EPOCHS):
            engine.begin_epoch(epoch, 1.0)
            sums[-1].append(engine.train_batches(runs, BATCH))
    (first, *epochs), (torch_first, *torch_epochs) = (
        [loss_values(plan, each) for each in engine] for engine in sums
    )
    exact, trained = TOLERANCES[dtype]
    assert first == pytest.approx(torch_first, rel=exact)
    for ours, theirs in zip(epochs, torch_epochs, strict=True):
        assert ours == pytest.approx(theirs, rel=trained)
