"""Records statuses and a hash of the estimates of a moving-horizon estimator's golden steps."""

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
    """Status of each correction and prediction, and a 32-bit hash of all estimates.

    The hash is that of `recorded_bits`.
    """

    corrected: tuple[int, ...]
    predicted: tuple[int, ...]
    bits: int


def recorded_windows(
    golden: GoldenSteps, texts: Mapping[str, str], name: str
) -> RecordedWindows | None:
    """Compiles the files and runs the golden steps; returns None without a working C compiler.

    Results are bit-identical for every compiler.
    """
    # Windows cannot remove a library while it is loaded
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as place:
        # the three sources of the estimator cannot be joined into one translation unit
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
            estimate = library.correct_numbers(step.measured, step.given)
            corrected.append(estimate.status)
            predicted.append(library.predict_numbers(step.given))
            for values in (estimate.x, estimate.std):
                for word in values.view(np.uint32).tolist():
                    hashed = ((hashed ^ word) * 16777619) & 0xFFFFFFFF
                    hashed ^= hashed >> 15
    return RecordedWindows(tuple(corrected), tuple(predicted), hashed)
