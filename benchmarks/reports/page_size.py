"""Measures how large the page of a run is whose records have 100,000 samples of four signals.

python benchmarks/reports/page_size.py [--write]    # writes RESULTS.md
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np

import msnn

SAMPLES = 100_000
SPEC = """\
msnn: 1
name: oven
sample_time: 0.1 s
inputs: {a: W, b: W, c: W, y: K}
layers: {f: {fir: {window: 2}}, g: {linear: {}}}
outputs: {next: {expr: "f(y) + g(a, b, c)", predicts: "y[t+1]"}}
data: {source: {all: log.csv}, split: {val: 0.2, test: 0.2, by: fraction}}
train: [{epochs: 1, batch: 5000}]
"""
_TEXT = """\
# The page of a run

Written by `python benchmarks/reports/page_size.py --write`: {samples:,} samples of four signals, a
model trained for one epoch. The page that `msnn report` writes has {size:.1f} MB.
"""


def main() -> None:
    """Prints the size."""
    parser = argparse.ArgumentParser(description="Measures the page of a run.")
    parser.add_argument("--write", action="store_true")
    given = parser.parse_args()
    random = np.random.default_rng(5)
    frame = {name: np.repeat(random.uniform(0, 1, SAMPLES // 50), 50) for name in "abc"}
    frame["y"] = np.cumsum(frame["a"] - frame["b"]) * 1e-3 + 0.01 * random.standard_normal(SAMPLES)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        spec = folder / "oven.msnn.yaml"
        spec.write_text(SPEC, encoding="utf-8")
        msnn.train(msnn.load(spec), frame, runs=folder / "runs")
        page = folder / "report.html"
        msnn.report(folder / "runs" / "oven" / "latest", file=page, data=frame)
        size = page.stat().st_size
    text = _TEXT.format(samples=SAMPLES, size=1e-6 * size)
    print(text)
    if given.write:
        Path(__file__).with_name("RESULTS.md").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
