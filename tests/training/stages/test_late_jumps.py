"""A stage that does not settle is told which key and value to write."""

from __future__ import annotations

import numpy as np

from msnn.training.records.progress import Silent
from msnn.training.train import TrainingOptions, train
from spec_schema.diagnostics.diagnostic import Diagnostic
from tests.conditions import require_tool
from tests.training.cases import compiled, dataset

LINE = """
msnn: 1
name: line
inputs: {u: 1}
targets: {y: 1}
parameters: {a: 0, b: 0}
outputs: {z: {expr: a * u + b, predicts: "y[t]"}}
train: [{epochs: 80, batch: 4, engine: native, STAGE}]
"""


class Warnings(Silent):
    """Keeps what a run warns of."""

    def __init__(self) -> None:
        self.said: list[Diagnostic] = []

    def warned(self, diagnostic: Diagnostic) -> None:
        self.said.append(diagnostic)


def hints(stage: str) -> list[Diagnostic]:
    program, spec = compiled(LINE.replace("STAGE", stage))
    random = np.random.default_rng(3)
    u = random.normal(size=60)
    y = 2 * u + 0.02 * random.normal(size=60)
    heard = Warnings()
    data = dataset({"u": u, "y": y}, train=[60])
    train(program, data, spec.train, TrainingOptions(runs=None), heard)
    return [d for d in heard.said if d.code == "W0913"]


def test_a_rate_that_stays_too_large_is_named_with_a_smaller_one() -> None:
    require_tool("gcc", install="apt install gcc")
    (found,) = hints("optimizer: {adam: {lr: 0.3}}, schedule: {exponential: {factor: 1}}")
    assert "`train.0.optimizer.adam.lr: 0.09`" in (found.help or "")
    assert hints("optimizer: {adam: {lr: 0.3}}, schedule: {cosine: {}}") == []
    assert hints("optimizer: {adam: {lr: 0.005}}, schedule: {exponential: {factor: 1}}") == []
