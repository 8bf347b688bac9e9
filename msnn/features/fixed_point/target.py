"""The target `c` in integers: entries of `c` with `dtype: q15` or `q31`."""

from __future__ import annotations

import json
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from compiler.ir.program import Declared, State
from compiler.passes.limit_expected import limit_expected
from msnn.agreement.judgement import (
    AgreementRecord,
    Arrays,
    Beginning,
    Judgement,
    Loaded,
    NumberType,
    Promise,
)
from msnn.exports.prepare import name_prefix, step_program
from msnn.exports.target import ExportPlan, Request, Target, Weights, Written, interpreted
from msnn.features.fixed_point.errors import (
    fixed_point_option,
    no_integer_node,
    no_integer_slopes,
    saturates_all_the_same,
)
from msnn.tables import table_text
from spec_schema.diagnostics.diagnostic import Diagnostic, SpecError
from spec_schema.sections.exports import CExport

MOST_STEPS = 1000
"""Maximum number of steps that the integer interpreter runs."""


def _prepare(request: Request, entry: CExport | None) -> ExportPlan[None] | None:
    assert entry is not None, "only an entry asks for fixed point"
    assert entry.dtype is not None
    step = step_program(request, entry, entry.delay)
    if step is None:
        return None
    report, place = request.findings.report, entry.place.key
    # words have no room beyond a range: equations keep to theirs in the judge as well
    step = limit_expected(step)
    report(*(fixed_point_option(name, place) for name in _float_options(entry)))
    extras = {*request.extras, *entry.extras}
    if "ros2" in extras:
        report(no_integer_node(place))
    if extras - {"ros2"}:
        report(no_integer_slopes(place))
    # `on_range: flag` lets a float leave its range; a word stays at its end
    flagged = [state.name for state in step.states if _is_flagged(state)]
    if flagged:
        report(saturates_all_the_same(flagged, place))
    return ExportPlan(
        target=TARGET,
        program=step,
        prefix=name_prefix(request, entry.prefix),
        dtype=entry.dtype,
        options=None,
    )


def _float_options(entry: CExport) -> list[str]:
    """The options of floating-point C that an entry sets to other than their defaults."""
    options = ("params", "math", "ring", "unroll", "constant_time")
    usual = {name: CExport.model_fields[name].default for name in options}
    return [name for name, value in usual.items() if getattr(entry, name) != value]


def _is_flagged(state: State) -> bool:
    """True for a declared state that may leave its range in floating point."""
    flags = state.on_range == "flag" and state.range is not None
    return flags and isinstance(state.origin, Declared)


def _write(plan: ExportPlan[None], weights: Weights, folder: Path) -> tuple[Path, ...]:
    from msnn.features.fixed_point.backend import write_fixed_c

    return write_fixed_c(plan.program, weights, folder, plan.prefix, plan.dtype).files


@contextmanager
def _load(plan: ExportPlan[None], written: Written) -> Generator[Loaded]:
    from msnn.exports.running.built_c import built_c

    about = json.loads((written.folder / f"{plan.prefix}.json").read_text(encoding="utf-8"))
    scales = {name: _Scale.of(fields) for name, fields in about["c"]["structs"].items()}
    with built_c(written) as step:

        def run(beginning: Beginning, inputs: Arrays, steps: int) -> Arrays:
            step.reset(scales["init"].words(beginning.windows))
            return scales["out"].numbers(step.run(scales["in"].words(inputs), steps)[0])

        yield Loaded(run)


@dataclass(frozen=True, slots=True)
class _Scale:
    """The scales and limits of the words of a struct, as its fields in the JSON description by
    name.
    """

    fields: Mapping[str, Mapping[str, Any]]

    @staticmethod
    def of(fields: Sequence[Mapping[str, Any]]) -> _Scale:
        return _Scale({field["name"]: field for field in fields if field["name"] is not None})

    def words(self, numbers: Arrays) -> Arrays:
        """The nearest words within their ranges, for the fields of the struct."""
        return {name: self._words(field, numbers[name]) for name, field in self.fields.items()}

    def numbers(self, words: Arrays) -> Arrays:
        return {
            name: np.ldexp(words[name].astype(np.float64), -field["fraction"])
            for name, field in self.fields.items()
        }

    @staticmethod
    def _words(field: Mapping[str, Any], numbers: NDArray[Any]) -> NDArray[np.int64]:
        low, high = field["range"]
        # clipped first: beyond the range a word would wrap
        # to even, as the generated code rounds its constants
        return np.rint(np.ldexp(np.clip(numbers, low, high), field["fraction"])).astype(np.int64)


def _judge(
    plan: ExportPlan[None], weights: Weights, record: AgreementRecord, dtype: NumberType
) -> Judgement:
    """The expected results of the export: those of the integer interpreter for the inputs of the
    float64 interpreter.

    For the `dtype` float64 it returns the float64 run itself.
    """
    # inputs and states of the record as numbers: words are made of these
    floating = interpreted(plan, weights, record, "float64")
    if dtype == "float64":
        return floating
    from msnn.features.fixed_point.judged_words import judged_words

    return judged_words(plan.program, weights, dtype, floating, MOST_STEPS)


def _faults(plan: ExportPlan[None]) -> tuple[Diagnostic, ...]:
    """The diagnostics that keep the model from an export in fixed point with its initial weights;
    empty if it can be exported.
    """
    from compiler.interpreter.interpreter import physical_weights
    from msnn.features.fixed_point.compile.compile_integers import integer_program
    from msnn.features.fixed_point.integers.program import WIDTHS

    try:
        integer_program(plan.program, physical_weights(plan.program, {}), WIDTHS[plan.dtype])
    except SpecError as error:
        return error.diagnostics
    return ()


def _error_table(plan: ExportPlan[None], folder: Path) -> str:
    """Two tables of the errors against float64, as text, from the export in `folder`.

    The first lists measured errors over many steps, the second the proved maximum per step.
    """
    about = json.loads((folder / f"{plan.prefix}.json").read_text(encoding="utf-8"))
    rows = [
        (
            row["output"],
            f"{row['largest']:.2g}",
            f"{row['rms']:.2g}",
            f"{row['range']:.4g}",
            f"{row['largest'] / row['range']:.1e}" if row["range"] else "",
        )
        for row in about["errors"]
    ]
    steps = max((row["steps"] for row in about["errors"]), default=0)
    bounds = [
        (
            row["name"],
            row["kind"],
            "not proved" if (most := row["largest"]) is None else f"{most:.2g}",
        )
        for row in about["step_errors"]
        if row["largest"] != 0.0
    ]
    header = ("output", "largest error", "rms", "range", "of range")
    proved = table_text(("value", "kind", "at most"), bounds, numbers=[2]) if bounds else "nothing"
    return (
        f"Error of {about['c']['dtype']} against float64, seen over {steps:,} steps:\n"
        + table_text(header, rows, numbers=[1, 2, 3, 4])
        + f"\n\nWhat one step adds at most, proved:\n{proved}"
    )


TARGET: Target[CExport, None] = Target(
    name="c",
    entry=CExport,
    dtype="q15",
    options=None,
    promise=lambda dtype: Promise.BITS,
    is_verified=True,
    prepare=_prepare,
    write=_write,
    load=_load,
    judge=_judge,
    faults=_faults,
    tell=_error_table,
)
