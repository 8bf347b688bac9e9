"""What a stage says of losses, rates, limits and patience means the same with both engines."""

from __future__ import annotations

import pytest

from msnn.training.train import TrainingOptions, TrainingResult, train
from tests.conditions import require_tool
from tests.training.cases import compiled, dataset, gain_series

MODEL = """
msnn: 1
name: gain
sample_time: 1 s
inputs: {x: m, u: m}
parameters: {a: 0.5, b: 0.1}
outputs:
  x_next: {expr: "a*x + b*u", predicts: "x[t+1]", unit: m}
losses:
  fit: "mse(x_next, x[t+1])"
  sparse: {expr: "l1(b)", weight: 0.01}
  small: {expr: "l2(a)", weight: 0.01}
"""
STAGES = {
    "regularisers": "epochs: 6",
    "weights of losses": "epochs: 6, losses: {fit: 2, sparse: 0.3, small: 0}",
    "weight decay": "epochs: 6, weight_decay: 0.2",
    "clipping": "epochs: 6, clip: 0.01",
    "rates of parameters": "epochs: 6, lr: {a: 0.2, b: 3}",
    "a frozen parameter": "epochs: 6, freeze: [b]",
    "a cosine": "epochs: 6, schedule: {cosine: {}}",
    "a plateau": "epochs: 30, schedule: {plateau: {patience: 1, factor: 0.5}}",
    "early stop on a loss": "epochs: 40, early_stop: {monitor: sparse, patience: 3}",
    "early stop on the fit": "epochs: 40, early_stop: {monitor: fit, patience: 2}",
}


def trained(stage: str, engine: str) -> TrainingResult:
    common = "batch: 16, rollout: 4, dtype: float64, optimizer: {adam: {lr: 0.05}}"
    program, spec = compiled(f"{MODEL}train:\n  - {{{stage}, {common}, engine: {engine}}}\n")
    data = dataset(gain_series(150), train=[70], val=[40])
    return train(program, data, spec.train, TrainingOptions(runs=None))


@pytest.mark.parametrize("stage", STAGES)
def test_both_engines_train_alike(stage: str) -> None:
    require_tool("gcc", install="apt install gcc")
    (native,), (torch,) = (trained(STAGES[stage], name).stages for name in ("native", "torch"))
    counted = ("best_epoch", "epochs", "reason", "attempt")
    assert [getattr(native, c) for c in counted] == [getattr(torch, c) for c in counted]
    # float64 in the same order of batches: what differs is how sums are rounded
    assert native.best_value == pytest.approx(torch.best_value, rel=1e-9)
    for name, value in torch.best.items():
        assert native.best[name] == pytest.approx(value, rel=1e-8, abs=1e-10)
    plain = trained(STAGES[stage].split(",")[0], "torch").stages[0]
    if stage != "regularisers":
        assert (torch.epochs, torch.best["a"]) != (plain.epochs, plain.best["a"])
