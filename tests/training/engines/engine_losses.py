"""What every engine says of the losses of a stage, for comparison with plain numpy."""

from __future__ import annotations

from collections.abc import Mapping

from msnn.data.dataset import Dataset, FloatArray
from msnn.simulation.rollout import LossSum
from msnn.training.engines.open_engine import open_engine
from msnn.training.plans.stage_data import stage_data
from msnn.training.plans.stage_plan import plan_stages
from msnn.training.stages.stage_starts import stage_starts
from spec_schema.diagnostics.diagnostic import Findings
from tests.training.cases import compiled

ENGINES = ("native", "torch")
OPTIMIZERS = ("{adam: {lr: 0.01}}", "{levenberg_marquardt: {}}", "{lbfgs: {}}")


def losses(
    model: str, stage: str, data: Dataset, weights: Mapping[str, FloatArray]
) -> tuple[dict[str, LossSum], dict[str, LossSum], Mapping[str, FloatArray]]:
    """Of the train rows at these weights, trained on in one batch and watched; the weights then."""
    program, spec = compiled(f"{model}train:\n  - {{{stage}}}\n")
    findings = Findings()
    plans = plan_stages(program, spec.train, findings)
    findings.raise_errors()
    found = stage_data(plans[0], data, findings)
    findings.raise_errors()
    assert found is not None
    engine = open_engine(plans[0], data.series, weights, found).engine
    starts = stage_starts(plans[0], data, found, lambda _: None)
    if starts is not None:
        engine.write(starts.for_watching(found.watched, engine.weights()), watched=True)
        engine.write(starts.for_training(found.train, engine.weights()), watched=False)
    watched = engine.evaluate(found.watched)
    engine.begin_epoch(0, 1.0)
    trained = engine.train_batches(found.train, len(found.train))
    return trained, watched, engine.weights()
