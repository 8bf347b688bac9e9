"""Writes the files of a Kalman filter: header, source, kernels, self-test, JSON description."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from backends.c.folder.header_text import origin
from backends.c_kernels.sources import c_sources
from backends.c_language.functions import FunctionNames, FunctionTable
from backends.c_language.literals import Dtype
from backends.c_language.printer import Printer
from backends.c_language.rendering import GeneratedNames, render
from backends.files.export_identity import with_identity
from compiler.jacobian.matrices import Vector, vector_of
from compiler.passes.inline_parameters import inline_parameters
from msnn.features.control.backend.about import StructMember
from msnn.features.control.backend.constants import TypedLiterals
from msnn.features.control.backend.filter_fields import (
    FilterField,
    filter_description,
    input_fields,
    measured_fields,
)
from msnn.features.control.backend.filter_functions import filter_functions
from msnn.features.control.backend.golden_filter import golden_steps, recorded_bits
from msnn.features.control.backend.inputs import quantity_lines
from msnn.features.control.kalman_filter import KalmanFilter
from msnn.features.control.problem.state_estimation import EstimationProblem, augmented


def filter_texts(
    problem: EstimationProblem, weights: Mapping[str, ArrayLike], prefix: str, dtype: Dtype
) -> dict[str, str]:
    """Returns the text of each file of an extended Kalman filter, by relative path.

    `weights` has the value of each parameter by name.
    """
    made = filter_sources(problem, weights, f"{prefix}_ekf", dtype)
    golden = golden_steps(problem, weights, dtype)
    bits = recorded_bits(golden, made.texts, made.name)
    test = made.text("selftest.c.j2", "Self-test of the Kalman filter", golden=golden, bits=bits)
    return with_identity(dict(sorted({**made.texts, f"src/{made.name}_selftest.c": test}.items())))


@dataclass(frozen=True, slots=True, kw_only=True)
class FilterSources:
    """The files of a filter without its self-test, and the variables of its templates."""

    name: str
    texts: dict[str, str]
    facts: dict[str, Any]
    struct: list[StructMember]

    def text(self, template: str, title: str, folder: str = "estimation", **more: Any) -> str:
        """Renders a template of `folder` with `facts` and further variables; `title` is the first
        line of the file.
        """
        named = GeneratedNames(self.facts["model"], self.name)
        return render(template, named, title, folder, **(self.facts | more))


def filter_sources(
    problem: EstimationProblem,
    weights: Mapping[str, ArrayLike],
    name: str,
    dtype: Dtype,
    *,
    around: bool = False,
) -> FilterSources:
    """Writes the sources of a filter, without the self-test; `name` is the prefix of files and
    functions, `weights` has the physical value of each parameter by name.

    With `around`, functions linearise at a point that the caller passes, instead of the estimate.
    """
    reference = KalmanFilter(problem, weights)
    estimated = reference.numbers
    numbers = TypedLiterals(dtype)
    # the smallest normal number: many microcontrollers flush subnormal numbers to 0
    smallest = float(np.finfo(dtype).tiny)
    table = FunctionTable(FunctionNames(name, dtype, "own"))
    program = inline_parameters(augmented(problem.program, problem.parameters), weights)
    functions = filter_functions(problem, program, estimated, table, numbers.real)
    given = input_fields(problem, estimated)
    measured, read = measured_fields(
        problem, [field for field in given if field.name in functions.read], smallest
    )
    # only elements with process noise have a column in the update of the factor
    moving = [int(i) for i in np.flatnonzero(reference.drift)]
    struct = _members(estimated.size, problem, measured, len(moving), numbers.real)
    signals = vector_of("innovation", [_innovation(problem, m.value) for m in problem.measured])
    facts: dict[str, Any] = {
        "model": problem.program.name,
        "around": around,
        **origin(problem.program),
        "about": numbers.comment(_about(problem)),
        "real": numbers.real,
        "num": numbers.literal,
        "braced": numbers.braced,
        "sqrt": "sqrtf" if dtype == "float32" else "sqrt",
        "nan": "NAN" if dtype == "float32" else "(double)NAN",
        "smallest": numbers.literal(smallest),
        "states": problem.states.size,
        "estimated": estimated.size,
        "measured": signals.size,
        "input_fields": given,
        "measured_fields": measured,
        "read_fields": read,
        "lines": quantity_lines(estimated, "x"),
        "innovation_lines": quantity_lines(_named(problem, signals), "innovation"),
        "members": struct,
        "functions": [
            Printer(name, dtype).function(function)
            for function in (*table.definitions(), *functions.functions)
        ],
        "kernels": bool(table.kernels),
        "start": reference.vector.tolist(),
        "known": [int(known) for known in reference.is_known],
        # the initial covariance is diagonal: elements are independent before the first measurement
        "first": np.diagonal(reference.covariance).tolist(),
        "noises": moving,
        # a small variance must not round to 0 in float32
        "noise": [max(float(reference.drift[i]), smallest) for i in moving],
        "bounds": [
            {
                "first": estimated.member(parameter).first,
                "end": estimated.member(parameter).first + estimated.member(parameter).size,
                "low": bound.minimum,
                "high": bound.maximum,
            }
            for parameter, bound in problem.parameters.items()
            if bound.minimum is not None or bound.maximum is not None
        ],
        "inputs": problem.inputs.size,
        "infinite": "INFINITY" if dtype == "float32" else "(double)INFINITY",
    }

    made = FilterSources(name=name, texts={}, facts=facts, struct=struct)
    texts = {
        f"include/{name}.h": made.text("header.h.j2", "Kalman filter"),
        f"src/{name}.c": made.text("filter.c.j2", "Kalman filter"),
        f"{name}.json": filter_description(
            name,
            dtype,
            estimated,
            states=problem.states.size,
            struct=struct,
            given=given,
            measured=(*measured, *read),
        ),
    }
    if table.kernels:
        kernels = c_sources(table.kernels, numbers.real, name)
        texts[f"src/{kernels.header_name}"] = kernels.header
        texts[f"src/{kernels.source_name}"] = kernels.source
    return replace(made, texts=texts)


def _members(
    size: int,
    problem: EstimationProblem,
    measured: tuple[FilterField, ...],
    noises: int,
    real: str,
) -> list[StructMember]:
    """Lists the members of a filter's state struct.

    ξ has `size` elements, of which `noises` have process noise.
    """
    most = max([size, *(field.size for field in measured)])

    def reals(name: str, *shape: int) -> StructMember:
        return StructMember(name, "real", shape, real)

    return [
        StructMember("ready", "uint32", (), real),
        StructMember("known", "uint8", (size,), real),
        reals("x", size),
        reals("factor", size, size),
        # C has no empty arrays
        reals("given", max(problem.inputs.size, 1)),
        reals("next", size),
        reals("gain", size),
        reals("moved", size),
        reals("results", most),
        reals("slopes", most * size),
        # propagated factor and noise columns, which orthogonalisation makes triangular again
        reals("work", size, size + noises),
    ]


def _innovation(problem: EstimationProblem, value: str) -> tuple[str, Any, Any]:
    """Returns name, axes and unit of a measured output."""
    type = problem.program.step[problem.program.output(value).node].type
    return value, type.axes, type.unit


def _named(problem: EstimationProblem, vector: Vector) -> Vector:
    """Returns the vector of measured outputs with the names of their signals."""
    signals = [m.signal for m in problem.measured]
    return vector_of(
        vector.letter,
        [(s, m.axes, m.unit) for s, m in zip(signals, vector.members, strict=True)],
    )


def _about(problem: EstimationProblem) -> str:
    """Returns the comment at the top of the header."""
    measured = ", ".join(measurement.signal for measurement in problem.measured)
    return (
        f"Estimates the states of the model from what is measured of it ({measured}) by the "
        f"extended Kalman filter of the spec's `estimator` section, sample by sample."
    )
