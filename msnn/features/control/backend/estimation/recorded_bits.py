"""Records the bits that a filter gives for its golden steps."""

from __future__ import annotations

import json
from collections.abc import Mapping

import numpy as np

from msnn.features.control.backend.estimation.golden_filter import GoldenSteps
from msnn.features.control.backend.estimation.library import FilterLibrary
from msnn.features.control.backend.selftest.recorded import compiled_texts


def recorded_bits(golden: GoldenSteps, texts: Mapping[str, str], name: str) -> int | None:
    """Mixed FNV-1a of the words of all estimates and deviations; None where nothing compiles."""
    built = compiled_texts(texts)
    if built is None:
        return None
    library = FilterLibrary(json.loads(texts[f"{name}.json"]), built)
    library.reset(golden.start)
    # FNV-1a by words carries bits upwards alone: the shift below brings the high ones down
    hashed = 2166136261
    for step in golden.steps:
        found = library.correct_numbers(step.measured, step.given)
        library.predict_numbers(step.given)
        for values in (found.x, found.std):
            for word in values.view(np.uint32).tolist():
                hashed = ((hashed ^ word) * 16777619) & 0xFFFFFFFF
                hashed ^= hashed >> 15
    return hashed
