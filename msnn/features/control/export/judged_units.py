"""Compares units of a controller and an estimator with the C that they are made of, bit by bit."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from backends.fmu.variable import Variable, VariableKind
from msnn.agreement.agreement import Agreement, other_bits
from msnn.agreement.judgement import FloatType
from msnn.exports.running.loaded_fmu import FmuInstance, fmu_instance
from msnn.exports.target import Weights
from msnn.features.control.backend.golden_filter import golden_steps
from msnn.features.control.backend.library import ControllerLibrary, FilterLibrary
from msnn.features.control.export.judged_controller import drawn_samples
from msnn.features.control.fmu.controller_unit import controller_unit
from msnn.features.control.fmu.filter_unit import filter_unit
from msnn.features.control.fmu.online_unit import OnlineUnit
from msnn.features.control.problem.optimal_control import ControlProblem
from msnn.features.control.problem.state_estimation import EstimationProblem
from msnn.features.control.problem.trained import trained

Array = NDArray[np.floating]
Numbers = Mapping[str, Array]
"""By the name of a variable."""


def compare_controller_units(
    problem: ControlProblem, weights: Weights, folder: Path, dtype: FloatType, target: str
) -> Agreement:
    """Compares the FMUs of a controller with its C code, bit by bit, for random samples. `folder`
    contains the units and the built `controller.so`.
    """
    problem = trained(problem, weights)
    library = ControllerLibrary.of_folder(folder, folder / "controller.so")
    unit = controller_unit(problem, _prefix(folder, "mpc"), dtype)
    states = {member.name: member for member in problem.states.members}
    with ExitStack() as stack:
        runs = [_UnitRun(unit, stack.enter_context(fmu_instance(p))) for p in _units(folder, unit)]
        count = 0
        for is_cold, x, _, fields in drawn_samples(problem):
            given: dict[str, Array] = {}
            for variable in unit.variables.of(VariableKind.INPUT):
                # where the unit keeps it in C: `u.x[3]`
                place = variable.place.removeprefix("u.").partition("[")[0]
                if place == "x":
                    member = states[variable.name]
                    given[variable.name] = x[member.first : member.first + member.size]
                else:
                    given[variable.name] = fields[place]
            if is_cold:
                library.init()
            decision = library.solve({"x": x} | fields)
            expected = {
                member.name: decision.control[member.first : member.first + member.size]
                for member in problem.controls.members
            }
            expected["residual"] = np.array(decision.residual)
            counts = (decision.status, decision.iterations)
            for run in runs:
                if is_cold:
                    run.begin({})
                run.compare(given, expected, counts)
            count += 1
    return _agreement(runs, count, dtype, target)


def compare_estimator_units(
    problem: EstimationProblem, weights: Weights, folder: Path, dtype: FloatType, target: str
) -> Agreement:
    """Compares the FMUs of an estimator with its C code, bit by bit, for random samples. `folder`
    contains the units and the built `controller.so`.
    """
    library = FilterLibrary.of_folder(folder, folder / "controller.so")
    (path,) = [*folder.glob("*_ekf.json"), *folder.glob("*_mhe.json")]
    about = json.loads(path.read_text(encoding="utf-8"))
    unit = filter_unit(problem, weights, about)
    golden = golden_steps(problem, weights, dtype)
    sizes = {v.name: v.size for v in unit.variables.all}
    measured = [f"measured.{m.signal}" for m in problem.measured]
    inputs = [m.name for m in problem.inputs.members]
    for name, member in zip(inputs, problem.inputs.members, strict=True):
        # inputs that are no variables of the unit are given to the library all the same
        sizes.setdefault(name, member.size)
    start = _split(golden.start, [f"start.{m.name}" for m in problem.states.members], sizes)
    library.reset(golden.start)
    with ExitStack() as stack:
        runs = [_UnitRun(unit, stack.enter_context(fmu_instance(p))) for p in _units(folder, unit)]
        for run in runs:
            run.begin(start)
        before: Numbers = {}
        for step in golden.steps:
            given = _split(step.given, inputs, sizes)
            now = {f"now.{name}": values for name, values in given.items()}
            found = library.correct_numbers(step.measured, step.given)
            # a unit predicts at the beginning of its step: it takes the inputs of the sample before
            numbers = {**before, **now, **_split(step.measured, measured, sizes)}
            known = {name: v for name, v in numbers.items() if name in unit_names(unit)}
            outputs = [v.name for v in unit.variables.of(VariableKind.OUTPUT)]
            solved = [] if found.iterations is None else [np.array([found.residual])]
            values = np.concatenate([found.x, found.std, found.innovation, *solved])
            counts = (found.status, *([] if found.iterations is None else [found.iterations]))
            expected = _split(values, outputs, sizes)
            for run in runs:
                run.compare(known, expected, counts)
            library.predict_numbers(step.given)
            before = given
    return _agreement(runs, len(golden.steps), dtype, target)


def unit_names(unit: OnlineUnit) -> frozenset[str]:
    """The names of all variables of a unit."""
    return frozenset(variable.name for variable in unit.variables.all)


class _UnitRun:
    """An FMU that is compared with its C code; `differing` counts values with other bits."""

    def __init__(self, unit: OnlineUnit, instance: FmuInstance) -> None:
        self._unit, self._instance = unit, instance
        self._every = instance.description.defaultExperiment.stepSize
        self._by_name = {variable.name: variable for variable in unit.variables.all}
        self._steps = 0
        self.version = str(instance.description.fmiVersion)
        self.differing = 0

    def begin(self, start: Numbers) -> None:
        self._steps = 0
        self._instance.initialise()
        self._set(start)
        self._instance.begin()

    def compare(self, given: Numbers, expected: Numbers, counts: Sequence[int]) -> None:
        """Does a step with the inputs `given`, and compares outputs with `expected`, status and
        iterations with `counts`.
        """
        self._set(given)
        self._instance.step(self._steps, float(self._every))
        self._steps += 1
        for name, values in expected.items():
            variable = self._by_name[name]
            found = self._instance.get(variable.first, (variable.size,))
            self.differing += _other(found, np.ravel(values))
        variables = self._unit.variables
        references = (variables.status_reference, variables.iterations_reference)
        # filters have no iterations to count
        # not counted in filters of one step
        for reference, value in zip(references, counts, strict=False):
            self.differing += self._instance.count(reference) != value

    def _set(self, values: Numbers) -> None:
        for name, numbers in values.items():
            variable: Variable = self._by_name[name]
            self._instance.set(variable.first, np.broadcast_to(np.ravel(numbers), variable.size))


def _agreement(runs: Sequence[_UnitRun], count: int, dtype: FloatType, target: str) -> Agreement:
    differing = {f"the unit of FMI {run.version}": run.differing for run in runs}
    return Agreement(
        target=target,
        dtype=dtype,
        steps=count,
        one_step=None,
        free_run=0.0,
        jacobian=None,
        bits=sum(differing.values()),
        faults=other_bits(differing),
        undecided={},
        untried=(),
        rounding={},
    )


def _units(folder: Path, unit: OnlineUnit) -> list[Path]:
    return [folder / "fmu" / f"{unit.prefix}_fmi{version}.fmu" for version in (2, 3)]


def _prefix(folder: Path, kind: str) -> str:
    (path,) = folder.glob(f"*_{kind}.json")
    return path.stem


def _split(
    numbers: Sequence[float] | Array, names: Sequence[str], sizes: Mapping[str, int]
) -> dict[str, Array]:
    found: dict[str, Array] = {}
    rest = np.ravel(np.asarray(numbers))
    for name in names:
        found[name], rest = rest[: sizes[name]], rest[sizes[name] :]
    return found


def _other(found: Array, expected: Array) -> int:
    """The number of values whose bits differ from the expected ones; any NaN equals any other."""
    # FMI 2.0 knows float64 alone, in which every float32 is exact
    given = found.astype(expected.dtype)
    same = (
        # by bytes: −0 and 0 compare equal as numbers
        given.view(np.uint8).reshape(given.size, -1)
        == np.ascontiguousarray(expected).view(np.uint8).reshape(given.size, -1)
    ).all(axis=1)
    return int(np.sum(~(same | (np.isnan(given) & np.isnan(expected)))))
