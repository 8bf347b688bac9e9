"""Records a hash of the estimates that a generated filter computes for its golden steps."""

from __future__ import annotations

import json
from collections.abc import Mapping

import numpy as np

from msnn.features.control.backend.estimation.golden_filter import GoldenSteps
from msnn.features.control.backend.estimation.library import FilterLibrary
from msnn.features.control.backend.selftest.recorded import compiled_texts


def recorded_bits(golden: GoldenSteps, texts: Mapping[str, str], name: str) -> int | None:
    """Returns a 32-bit hash of the bits of all estimates and standard deviations.

    It is FNV-1a over 32-bit words with an added shift. None without a working C compiler.
    """
    built = compiled_texts(texts)
    if built is None:
        return None
    library = FilterLibrary(json.loads(texts[f"{name}.json"]), built)
    library.reset(golden.start)
    # FNV-1a over words moves bits upwards only: the added shift moves high bits down
    hashed = 2166136261
    for step in golden.steps:
        estimate = library.correct_numbers(step.measured, step.given)
        library.predict_numbers(step.given)
        for values in (estimate.x, estimate.std):
            for word in values.view(np.uint32).tolist():
                hashed = ((hashed ^ word) * 16777619) & 0xFFFFFFFF
                hashed ^= hashed >> 15
    return hashed
