"""A stage that will need much memory says so before it begins."""

from __future__ import annotations

import numpy as np
import pytest

import msnn
from msnn.training.engines import open_engine as opening
from spec_schema.diagnostics.diagnostic import Diagnostic

SPEC = """
msnn: 1
name: lag
sample_time: 0.1 s
inputs: {u: {}, y: {}}
dims: {i: 4}
parameters: {a: 0.5, w: {init: 0.1, dims: [i]}}
outputs: {y_next: {expr: a * y + sum(w * u), predicts: "y[t+1]"}}
train:
  - {epochs: 1, batch: 64, engine: torch, rollout: {horizon: 20, stride: 1}}
"""


def warned(monkeypatch: pytest.MonkeyPatch, installed: int | None, **settings: object) -> list[str]:
    monkeypatch.setattr(opening, "installed_memory", lambda: installed)
    heard: list[object] = []
    model = msnn.load(SPEC, {f"train.0.{key}": value for key, value in settings.items()})
    record = {"u": np.ones(200), "y": np.ones(200)}
    msnn.train(model, record, runs=None, progress=heard.append)
    found = [event for event in heard if isinstance(event, Diagnostic)]
    return [each.message for each in found if each.code == "W0953"]


# of a step in float32: w * u (4), its sum, a * y, their sum, the two samples of y that are kept
STEP = 4 * (4 + 1 + 1 + 1 + 2)


def test_a_stage_on_torch_says_starts_times_steps_times_bytes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    total = 64 * 20 * STEP
    (message,) = warned(monkeypatch, 2 * total - 1)
    assert f"64 starts × 20 steps × {STEP} bytes" in message
    assert warned(monkeypatch, 2 * total) == []
    assert warned(monkeypatch, None) == []


def test_kernels_need_no_more_for_long_rollouts(monkeypatch: pytest.MonkeyPatch) -> None:
    assert warned(monkeypatch, 1, engine="auto") == []
