"""The target `casadi`: a step and an initial-state function with named ports."""

from __future__ import annotations

import json
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.casadi_function.options import CasadiOptions
from compiler.ir.program import NodeId, Program
from compiler.ir.types import Type
from compiler.jacobian.matrices import Matrix
from compiler.passes.smooth_kinks import Kink, kinks, sharp_kinks, smooth_kinks
from msnn.agreement.judgement import (
    Arrays,
    Beginning,
    ExportedSlopes,
    Loaded,
    loaded_by_steps,
    stacked,
)
from msnn.errors import workflow
from msnn.exports.prepare import MOST_ENTRIES, float_plan
from msnn.exports.target import ExportPlan, Request, Target, Weights, Written
from spec_schema.diagnostics.source import Span
from spec_schema.sections.exports import CasadiExport


def _prepare(request: Request, entry: CasadiExport | None) -> ExportPlan[CasadiOptions] | None:
    if entry is None:
        return float_plan(TARGET, request, None)
    if entry.dtype not in (None, TARGET.dtype):
        request.findings.report(workflow.casadi_is_double(entry.place.key))
    plan = float_plan(TARGET, request, entry, entry.prefix)
    if plan is None:
        return None
    options = CasadiOptions(params=entry.params, form=entry.form)
    program = smooth_kinks(plan.program) if entry.smooth else plan.program
    # True: those that could not be rounded off. Unsaid: all that the ranges reach. False: not to be
    # told
    if entry.smooth is not False:
        left = sharp_kinks(plan.program) if entry.smooth else kinks(plan.program)
        _warn(request, plan.program, left, stays=entry.smooth is True)
    return replace(plan, options=options, program=program)


def _warn(request: Request, program: Program, found: Mapping[NodeId, Kink], *, stays: bool) -> None:
    """Warns about kinks of the model, once for each place in the spec."""
    entries = (*program.signals, *program.states, *program.expected)
    ranges = {entry.name: entry.range for entry in entries}
    places: dict[Span, Kink] = {}
    for node, kink in found.items():
        span = program.step[node].span
        if span is not None:
            # one formula may have several nodes with kinks
            places.setdefault(span, kink)
    for span, kink in places.items():
        declared = {name: limits for name in sorted(kink.distance.of) if (limits := ranges[name])}
        request.findings.report(workflow.kink_within_ranges(kink.word, declared, span, stays=stays))


def _write(plan: ExportPlan[CasadiOptions], weights: Weights, folder: Path) -> tuple[Path, ...]:
    from backends.casadi_function.files import write_casadi

    return write_casadi(plan.program, weights, folder, plan.prefix, plan.options)


@contextmanager
def _load(plan: ExportPlan[CasadiOptions], written: Written) -> Generator[Loaded]:
    exported = _CasadiExport(written.folder, plan.prefix)
    slopes = partial(_slopes, plan.program, plan.options, exported)
    yield loaded_by_steps(exported.start, exported.step, slopes)


def _slopes(
    program: Program, options: CasadiOptions, exported: _CasadiExport
) -> ExportedSlopes | None:
    """The derivative of the step by CasADi, to compare it; None if the matrices are too large."""
    from backends.ports.step_interface import step_interface
    from compiler.jacobian.jacobian import jacobian

    ports = step_interface(program)
    states = sum(Type(state.axes).size for state in ports.states)
    # matrices are rows of x or y by columns of x, u or p
    rows = max(states, sum(program.step[output.node].type.size for output in ports.outputs))
    if rows * max(states, sum(port.type.size for port in ports.inputs)) > MOST_ENTRIES:
        return None
    parameters = sum(Type(parameter.axes).size for parameter in ports.parameters)
    by_parameters = options.params == "input" and rows * parameters <= MOST_ENTRIES
    slopes = jacobian(program, parameters=by_parameters)
    return ExportedSlopes(slopes, partial(exported.slopes, slopes.matrices))


TARGET: Target[CasadiExport, CasadiOptions] = Target(
    name="casadi",
    entry=CasadiExport,
    dtype="float64",
    options=CasadiOptions(),
    prepare=_prepare,
    write=_write,
    load=_load,
)


class _CasadiExport:
    """Runs the exported functions `<prefix>.casadi` and `<prefix>_initial_state.casadi`.

    `<prefix>.json` describes them.
    """

    def __init__(self, folder: Path, prefix: str) -> None:
        import casadi

        self._about = json.loads((folder / f"{prefix}.json").read_text(encoding="utf-8"))
        self._step: Any = casadi.Function.load(str(folder / f"{prefix}.casadi"))
        self._start: Any = casadi.Function.load(str(folder / f"{prefix}_initial_state.casadi"))
        self._parameters = {
            entry["port"]: np.array(entry["values"]) for entry in self._about["parameters"]
        }

    def start(self, beginning: Beginning) -> Arrays:
        about = self._about["start_windows"]
        given = {e["port"]: beginning.windows[e["name"]].ravel() for e in about}
        values = self._call(self._start, given)
        return {e["name"]: _shaped(values[e["port"]], e)[None] for e in self._about["states"]}

    def step(self, inputs: Arrays, states: Arrays, steps: int) -> tuple[Arrays, Arrays]:
        outputs: list[Arrays] = []
        following: list[Arrays] = []
        for k in range(steps):
            given = {e["port"]: inputs[e["name"]][k].ravel() for e in self._about["inputs"]}
            given |= {e["port"]: states[e["name"]][k].ravel() for e in self._about["states"]}
            values = self._call(self._step, given)
            outputs.append(
                {e["name"]: _shaped(values[e["port"]], e) for e in self._about["outputs"]}
            )
            following.append(
                {e["name"]: _shaped(values[e["next_port"]], e) for e in self._about["states"]}
            )
        return stacked(outputs), stacked(following)

    def slopes(
        self, matrices: Sequence[Matrix], inputs: Arrays, states: Arrays, steps: int
    ) -> Arrays:
        """The Jacobian matrices by name, (steps, rows, columns), computed by CasADi's
        differentiation.
        """
        # CasADi's own, so that it judges ours and not the other way round
        derivative = self._step.jacobian()
        found: list[Arrays] = []
        for k in range(steps):
            given = {e["port"]: inputs[e["name"]][k].ravel() for e in self._about["inputs"]}
            given |= {e["port"]: states[e["name"]][k].ravel() for e in self._about["states"]}
            blocks = self._call(derivative, given)
            found.append({matrix.name: self._matrix(matrix, blocks) for matrix in matrices})
        return stacked(found)

    def _matrix(self, matrix: Matrix, blocks: Arrays) -> NDArray[np.float64]:
        """One matrix, put together from blocks: one for each quantity in its rows and columns."""
        ends = {
            "x": self._ports("states", "next_port"),
            "y": self._ports("outputs", "port"),
        }[matrix.rows.letter]
        begins = self._ports(
            {"x": "states", "u": "inputs", "p": "parameters"}[matrix.columns.letter], "port"
        )
        whole = np.zeros(matrix.shape)
        for row in matrix.rows.members:
            for column in matrix.columns.members:
                block = blocks[f"jac_{ends[row.name]}_{begins[column.name]}"]
                whole[row.first :, column.first :][: row.size, : column.size] = block
        return whole

    def _ports(self, table: str, key: str) -> dict[str, str]:
        return {entry["name"]: entry[key] for entry in self._about[table]}

    def _call(self, function: Any, given: Arrays) -> Arrays:
        known = set(function.name_in())
        # not every function takes all parameters, as that of the first states
        arguments = {n: v for n, v in {**given, **self._parameters}.items() if n in known}
        return {name: np.array(value) for name, value in function.call(arguments).items()}


def _shaped(column: NDArray[Any], entry: Mapping[str, Any]) -> NDArray[Any]:
    # CasADi has columns; elements follow each other in C order
    return column.ravel().reshape([axis["size"] for axis in entry["axes"]])
