"""A stage whose losses say nothing of what it trains is refused before it runs, in every engine.

One whose losses say nothing of the data is warned of.
"""

from __future__ import annotations

import pytest

from msnn.training.plans.stage_plan import plan_stages
from spec_schema.diagnostics.diagnostic import Findings
from tests.training.cases import compiled

MODEL = """
msnn: 1
name: still
sample_time: 1 s
inputs: {u: {}, v: {}}
targets: {y: {}}
parameters: {k: 1, m: 2, s: 0.5}
states: {x: {next: "k * x + u", init: "s * y.meas"}}
outputs: {z: "m * x"}
losses: {still: "mse(u, v)", moved: "mse(x, y)", fit: "mse(z, y)"}
train: [{STAGE}]
"""


@pytest.mark.parametrize(
    ("stage", "codes"),
    [
        ("epochs: 1", []),
        ("losses: {moved: 0, fit: 0}", ["E0934"]),
        ("losses: {moved: 0, fit: 0}, engine: torch", ["E0934"]),
        ("freeze: [k, s], losses: {fit: 0}", ["E0934"]),
        ("freeze: [k, s], losses: {still: 0, fit: 0}", ["E0934"]),
        ("freeze: [k, s], losses: {still: 0, moved: 0}", []),
        ("freeze: [m, s], losses: {still: 0, fit: 0}", []),  # through the state
        ("freeze: [m, k], losses: {still: 0, fit: 0}", []),  # through its start
    ],
)
def test_a_stage_needs_a_loss_of_what_it_trains(stage: str, codes: list[str]) -> None:
    program, spec = compiled(MODEL.replace("STAGE", stage))
    findings = Findings()
    plan_stages(program, spec.train, findings)
    assert [found.code for found in findings.in_order] == codes


@pytest.mark.parametrize(
    ("losses", "warns"),
    [
        ('{size: "l2(m)"}', True),
        ('{few: "l1(m)", near: "mse(m, 3)"}', True),
        ('{size: "l2(m)", fit: {expr: "mse(z, y)", weight: 0}}', True),
        ('{size: "l2(m)", fit: "mse(z, y)"}', False),
        ('{small: "mse(x, 0)"}', False),  # a state, which inputs move
        ('{small: "m * u"}', False),
    ],
)
def test_a_stage_that_looks_at_no_data_is_warned_of(losses: str, warns: bool) -> None:
    """With `losses:` what outputs predict does not count by itself."""
    text = MODEL[: MODEL.index("losses:")] + f"losses: {losses}\ntrain: [{{epochs: 1}}]\n"
    program, spec = compiled(text.replace('"m * x"', '{expr: "m * x", predicts: "u[t+1]"}'))
    findings = Findings()
    plan_stages(program, spec.train, findings)
    codes = [found.code for found in findings.in_order]
    assert codes == (["W0935"] if warns else [])
    if warns:
        assert 'add `z: "mse(z, u[t+1])"`' in (findings.in_order[0].help or "")
