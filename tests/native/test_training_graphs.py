"""The graphs of training have the slopes of their losses: reverse mode, forward mode, start."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from compiler.passes.close_loop import close_loop
from msnn.model.load import load_model
from msnn.model.model_data import read_data
from msnn.model.weights.weights_file import initial_weights
from msnn.training.plans.stage_data import stage_data
from msnn.training.plans.stage_plan import plan_stages
from spec_schema.diagnostics.diagnostic import Findings
from tests.examples.gallery import NAMES, gallery_copy, spec_of
from tests.language.compiled import compiled
from tests.native.graph_slopes import assert_slopes_agree, problem
from tests.native.test_kernel import MODELS, initial, log_of


@pytest.mark.parametrize("name", MODELS)
def test_slopes_of_the_models_of_tests(name: str) -> None:
    text, closed = MODELS[name]
    program = close_loop(compiled(text), closed)
    assert_slopes_agree(problem(program, log_of(program), np.arange(10, 15), 6, initial(program)))


@pytest.fixture(scope="module")
def gallery(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return gallery_copy(tmp_path_factory.mktemp("gallery"))


@pytest.mark.parametrize("name", NAMES)
def test_slopes_of_the_gallery(name: str, gallery: Path) -> None:
    model = load_model(spec_of(gallery, name))
    (plan,) = plan_stages(model.program, model.spec.train, Findings())
    data = read_data(model, None, "training")
    found = stage_data(plan, data, Findings())
    assert found is not None
    runs = found.train
    t0 = runs.t0[runs.steps >= min(4, int(runs.steps.max()))][::7][:3]
    steps = min(4, int(runs.steps.max()))
    begin = initial_weights(model.program)
    assert_slopes_agree(problem(plan.program, data.series, t0, steps, begin), directions=1)
