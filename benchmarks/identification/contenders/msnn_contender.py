"""Identifies a system with msnn: its spec, Levenberg-Marquardt over the whole record."""

from __future__ import annotations

import json
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path[:0] = [str(Path(__file__).resolve().parents[1]), str(Path(__file__).resolve().parents[3])]

from systems import SYSTEMS, beginning, first_values, processor_seconds  # noqa: E402

import msnn  # noqa: E402

SPEC = """\
msnn: 1
name: {name}
sample_time: {dt} s
inputs: {{u: {{between: hold}}}}
targets: {{y: "1"}}
parameters: {{{parameters}}}
states:
  {states}
integrator: rk4
outputs: {{measured: {{expr: {output}, predicts: "y[t]"}}}}
data: {{source: {{train: a.csv}}}}
train: [{{rollout: record, epochs: 60, optimizer: levenberg_marquardt, dtype: float64}}]
"""
system = SYSTEMS[sys.argv[1]]
data = np.load(sys.argv[2])
first = dict(zip(system.true, first_values(system), strict=True))
listed = ", ".join(
    f"{name}: {{init: {value!r}, scale: {abs(value)!r}}}"
    for name, value in ((name, float(value)) for name, value in first.items())
)
output = [line.split(":")[0].strip() for line in system.spec.splitlines()][system.output]
text = SPEC.format(
    name=sys.argv[1], dt=system.sample_time, parameters=listed, states=system.spec, output=output
)
seconds, computed = [], []
with tempfile.TemporaryDirectory() as place:
    file = Path(place) / "system.msnn.yaml"
    file.write_text(text, encoding="utf-8")
    frames = {"train": {"u": data["train_u"], "y": data["train_y"]}}
    for fit in range(2):
        began, before = beginning(fit)
        model = msnn.load(file)
        found = msnn.train(model, frames, runs=None)
        seconds.append(time.perf_counter() - began)
        computed.append(processor_seconds() - before)
    outputs = {}
    for name in ("train", "test"):
        frame = {"u": data[f"{name}_u"], "y": data[f"{name}_y"]}
        outputs[name] = np.asarray(
            msnn.simulate(model, frame, weights=found)[0].outputs["measured"]
        )
error = outputs["train"] - data["train_y"][: len(outputs["train"])]
clean = outputs["test"] - data["test_clean"][: len(outputs["test"])]
parameters = [float(found.weights[name]) for name in system.true]
print(
    json.dumps(
        {
            "seconds": seconds,
            "computed": computed,
            "loss": float(np.mean(error**2)),
            "test": float(np.std(clean)),
            "parameters": parameters,
        }
    )
)
