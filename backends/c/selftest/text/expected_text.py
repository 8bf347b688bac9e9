"""Writes the results of golden steps as text, which the harness compares line by line."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from backends.c.interface.interface import Interface
from backends.c.selftest.matrix_checksums import checksums
from backends.c.selftest.vectors.golden_vectors import GoldenVectors, joined


def expected_text(interface: Interface, runs: Sequence[GoldenVectors]) -> str:
    """One line per step: the status, then each output's bits in hexadecimal digits, or `nan`.

    If the Jacobian must be exact to the bit, its hash ends the line. An empty line separates runs.
    """
    # hashed together: one takes as long as all
    lines = _lines(interface, joined(runs))
    ends = np.cumsum([len(run.status) for run in runs]).tolist()
    parts = [lines[begin:end] for begin, end in zip([0, *ends], ends, strict=False)]
    return "\n".join("\n".join(part) + "\n" for part in parts)


def _lines(interface: Interface, golden: GoldenVectors) -> list[str]:
    steps = len(golden.status)
    parts = [golden.outputs[field.name].reshape(steps, -1) for field in interface.outputs]
    rows = np.concatenate(parts, axis=1) if parts else np.empty((steps, 0), np.float32)
    hashed = interface.hashes_slopes
    hashes = checksums(golden.slopes) if hashed else []
    digits = 2 * rows.itemsize
    # decimals would hide the last bit, or take 17 digits to show it
    bits = rows.view(f"u{rows.itemsize}")
    return [
        " ".join(
            [
                f"{golden.status[k]:08x}",
                *(
                    "nan" if nan else f"{word:0{digits}x}"
                    for word, nan in zip(bits[k].tolist(), np.isnan(rows[k]), strict=True)
                ),
                *([f"{hashes[k]:08x}"] if hashed else []),
            ]
        )
        for k in range(steps)
    ]
