"""Writes the C files of a state estimator: extended Kalman filter or moving-horizon estimator."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from backends.c.host.build import CompilerFailedError, build_library
from backends.c_language.literals import Dtype
from backends.files.atomic_write import write_text
from backends.files.c_compiler import CompilerMissingError
from backends.files.export_identity import with_identity
from backends.native.compile_kernel import BRIEF
from backends.ports.metadata import metadata_text
from msnn.features.control.backend.constants import reachable
from msnn.features.control.backend.golden_filter import GoldenSteps, golden_steps
from msnn.features.control.backend.inputs import SeriesField, input_fields
from msnn.features.control.backend.library import FilterLibrary, struct_type
from msnn.features.control.backend.write_controller import solver_texts
from msnn.features.control.backend.write_filter import (
    FilterSources,
    filter_sources,
    filter_texts,
)
from msnn.features.control.problem.optimal_control import ControlProblem
from msnn.features.control.problem.state_estimation import EstimationProblem
from msnn.features.control.problem.trained import trained_window
from msnn.features.control.problem.window_problem import (
    RUNS,
    SPREAD,
    STARTS,
    WindowProblem,
    window_problem,
)


def write_estimator(
    problem: EstimationProblem,
    weights: Mapping[str, ArrayLike],
    folder: Path,
    *,
    prefix: str,
    dtype: Dtype,
) -> tuple[Path, ...]:
    """Writes header, sources and description of an estimator into a folder; returns their paths.
    Raises OSError if a file cannot be written.

    An extended Kalman filter has `include/<prefix>_ekf.h` and `src/<prefix>_ekf*.c`. Files of a
    moving-horizon estimator, a problem with a window, are named `<prefix>_mhe*`. `weights` has the
    physical value of each parameter by name.
    """
    texts = filter_texts if problem.window is None else horizon_texts
    written = texts(problem, weights, prefix, dtype).items()
    return tuple(write_text(folder / name, text) for name, text in written)


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
    """Compiles the files of a moving-horizon estimator and runs the golden steps. `name` is its
    prefix. Returns None without a working C compiler.

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


@dataclass(frozen=True, slots=True, kw_only=True)
class _Source:
    """An input or measurement: its fields in the structs of the filter and of the solver."""

    name: str
    """The field of the filter's struct."""
    size: int
    kept: str
    """The field of the solver's input struct that stores its samples of the window."""
    seen: str = ""
    """For a measurement, the field that is 1 for elements that were measured, otherwise 0."""
    number: int = 0
    """For an input, its index among all inputs."""


def horizon_texts(
    problem: EstimationProblem, weights: Mapping[str, ArrayLike], prefix: str, dtype: Dtype
) -> dict[str, str]:
    """Returns the text of each file of a moving-horizon estimator, by relative path.

    `weights` has the value of each parameter by name.
    """
    assert problem.window is not None
    name = f"{prefix}_mhe"
    known = filter_sources(problem, weights, f"{name}_filter", dtype, around=True)
    window = window_problem(problem)
    control = trained_window(window, weights)
    about = "Finds the noise of a window of samples that explains best what was measured in them."
    solver = f"{name}_window"
    texts = solver_texts(control, solver, dtype, "Window", about, is_window=True)
    # one JSON description of the whole, below, replaces those of the parts
    parts = {
        "window": json.loads(texts.pop(f"{solver}.json")),
        "filter": json.loads(known.texts.pop(f"{known.name}.json")),
    }
    texts |= known.texts
    facts = _facts(problem, window, control, known, name)
    own_part = FilterSources(name=name, texts={}, facts=known.facts | facts, struct=[])

    def text(template: str, title: str, **more: Any) -> str:
        return own_part.text(template, title, folder="moving_horizon", **more)

    texts |= {
        f"include/{name}.h": text("header.h.j2", "Moving-horizon estimator"),
        f"src/{name}.c": text("estimator.c.j2", "Moving-horizon estimator"),
        f"{name}.json": _description(name, dtype, parts, control, facts["sources"]),
    }
    golden = golden_steps(problem, weights, dtype)
    recorded = recorded_windows(golden, texts, name)
    test = text(
        "selftest.c.j2",
        "Self-test of the moving-horizon estimator",
        golden=golden,
        recorded=recorded,
    )
    return with_identity(dict(sorted({**texts, f"src/{name}_selftest.c": test}.items())))


def _facts(
    problem: EstimationProblem,
    window: WindowProblem,
    control: ControlProblem,
    known: FilterSources,
    name: str,
) -> dict[str, Any]:
    """Returns the variables of the templates beyond those of the filter."""
    fields = {field.name: field for field in input_fields(control)}
    return {
        "window": f"{name}_window",
        "filter": known.name,
        # the first stage, from the arrival estimate to the first sample, is not part of the window
        "horizon": control.horizon - 1,
        "iterations": control.iterations,
        "starts_again": control.starts_again,
        "most_iterations": control.most_iterations,
        "unsure": list(window.uncertain),
        "sources": [
            _Source(
                name=field.identifier,
                size=field.size,
                kept=fields[window.inputs[field.name]].identifier,
                number=number,
            )
            for number, field in enumerate(known.facts["input_fields"])
        ],
        "read_sources": [
            _Source(
                name=field.identifier,
                size=field.size,
                kept=fields[window.inputs[field.name]].identifier,
                number=[f.name for f in known.facts["input_fields"]].index(field.name),
            )
            for field in known.facts["read_fields"]
        ],
        "measured_sources": [
            _Source(
                name=field.identifier,
                size=field.size,
                kept=fields[window.measured(field.name)].identifier,
                seen=fields[window.seen(field.name)].identifier,
            )
            for field in known.facts["measured_fields"]
        ],
        "starts": fields[STARTS].identifier,
        "runs": fields[RUNS].identifier,
        "spread": _place(fields[SPREAD]),
        "kept_fields": [
            {"name": field.identifier, "count": field.count}
            for field in fields.values()
            if field.name in control.previewed
        ],
    }


def _place(field: SeriesField) -> str:
    """Returns a format string of the C expression of element i of a field."""
    return f"{field.identifier}[{{}}]" if field.shape else field.identifier


def _description(
    name: str,
    dtype: Dtype,
    parts: Mapping[str, dict[str, Any]],
    control: ControlProblem,
    sources: list[_Source],
) -> str:
    """Returns the JSON description of an estimator: that of its filter, extended by the solver.

    `parts` has the descriptions of filter and window; `sources` are the inputs.
    """
    filter, window = parts["filter"], parts["window"]
    # numpy aligns nested structs as C does, so that this gives sizeof the C struct
    nested: list[tuple[str, Any]] = [
        ("ready", np.dtype(np.uint32)),
        ("count", np.dtype(np.int32)),
        ("has_window", np.dtype(np.int32)),
        # C has no empty arrays
        ("given", np.dtype((np.uint8, (max(len(sources), 1),)))),
        ("filter", struct_type(filter["struct"])),
        ("arrival", struct_type(filter["struct"])),
        ("window", struct_type(window["struct"])),
        ("in", struct_type(window["in"])),
        ("solved", struct_type(window["out"])),
    ]
    size = np.dtype(nested, align=True).itemsize
    word = np.dtype(dtype).itemsize
    # callers allocate the struct as an array of values of this type
    assert size % word == 0
    return metadata_text(
        filter
        | {
            "prefix": name,
            "horizon": control.horizon - 1,
            "iterations": control.iterations,
            "starts_again": control.starts_again,
            "most_iterations": control.most_iterations,
            "tolerance": reachable(control.tolerance, dtype),
            "out": [
                *filter["out"],
                {"name": "residual", "type": dtype, "shape": []},
                {"name": "iterations", "type": "int32", "shape": []},
            ],
            "struct": [{"name": "memory", "type": dtype, "shape": [size // word]}],
        }
    )
