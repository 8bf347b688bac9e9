"""Records what a moving-horizon estimator gives for its golden steps, and its bits."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from backends.c.host.build import CompilerFailedError, build_library
from backends.files.c_compiler import CompilerMissingError
from backends.native.compile_kernel import BRIEF
from msnn.features.control.backend.estimation.golden_filter import GoldenSteps
from msnn.features.control.backend.estimation.library import FilterLibrary


@dataclass(frozen=True, slots=True)
class RecordedWindows:
    """The statuses of calls, and mixed FNV-1a of the words of all that they gave."""

    corrected: tuple[int, ...]
    predicted: tuple[int, ...]
    bits: int


def recorded_windows(
    golden: GoldenSteps, texts: Mapping[str, str], name: str
) -> RecordedWindows | None:
    """The results that every build gives; None where nothing compiles."""
    # Windows does not remove a library that is loaded
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as place:
        # the estimator is of three sources that do not go into one
        folder = Path(place)
        for path, text in texts.items():
            (folder / path).parent.mkdir(parents=True, exist_ok=True)
            (folder / path).write_text(text, encoding="utf-8")
        try:
            built = build_library(folder, folder / "estimator.so", flags=BRIEF)
        except (CompilerMissingError, CompilerFailedError):
            return None
        library = FilterLibrary.of_folder(folder, built)
        library.reset(golden.start)
        corrected: list[int] = []
        predicted: list[int] = []
        hashed = 2166136261
        for step in golden.steps:
            found = library.correct_numbers(step.measured, step.given)
            corrected.append(found.status)
            predicted.append(library.predict_numbers(step.given))
            for values in (found.x, found.std):
                for word in values.view(np.uint32).tolist():
                    hashed = ((hashed ^ word) * 16777619) & 0xFFFFFFFF
                    hashed ^= hashed >> 15
    return RecordedWindows(tuple(corrected), tuple(predicted), hashed)
