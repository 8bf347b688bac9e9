"""The predictive controller of a model: measures, solves, keeps its plan for the next sample."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from compiler.interpreter.interpreter import Interpreter
from compiler.ir.nodes import reads_log
from compiler.ir.program import History, Signal, Tape
from compiler.ir.types import Type
from compiler.jacobian.matrices import Vector, by_name
from msnn.features.control.problem.horizon import Array, Given, log_of
from msnn.features.control.problem.kkt import Judge, Residuals
from msnn.features.control.problem.optimal_control import ControlProblem
from msnn.features.control.run.control_range import ControlRange
from msnn.features.control.run.interior_point.horizon_functions import HorizonFunctions
from msnn.features.control.run.method import Found, Method, Solution, Status

if TYPE_CHECKING:
    from msnn.features.control.casadi.control_program import OptimalControlNlp


class Controller:
    """A predictive controller, `msnn.mpc(model)`. It stores its plan, the applied control and the
    predicted states from solve to solve.
    """

    def __init__(
        self, problem: ControlProblem, functions: HorizonFunctions, method: Method
    ) -> None:
        self.problem = problem
        self.solver = method.name
        """`c` or `python`: who solves."""
        self._functions, self._method = functions, method
        self._memory = Memory(problem)
        self._judge: Judge | None = None
        self._applied: Array | None = None

    def reset(
        self,
        x: Mapping[str, ArrayLike] | None = None,
        control: Mapping[str, ArrayLike] | None = None,
    ) -> None:
        """Deletes the plan and the memory. `x` are known states by name, `control` the controls
        that the plant receives now.

        Raises ValueError for an unknown name and another shape. A value that is not finite also
        raises it, and then leaves the controller as it was.
        """
        for name, value in {**(x or {}), **(control or {})}.items():
            if not np.isfinite(value).all():
                raise ValueError(f"`{name}` is {value}: leave out what is not known")
        self._memory.forget()
        self._applied = None
        if control is not None:
            self._applied = _joined(self.problem.controls, control, "control")
        self._method.forget(self._applied)
        if x is not None:
            self._memory.measure(x)

    def solve(
        self,
        x: Mapping[str, ArrayLike] | None = None,
        *,
        references: Mapping[str, ArrayLike] | None = None,
        disturbances: Mapping[str, ArrayLike] | None = None,
    ) -> Solution:
        """The control at t, and the plan that begins with it.

            found = controller.solve({"upper": 2.0, "lower": 3.0}, references={"level": 6.0})
            apply(found.control["pump"])

        `x` are measured states, and measured samples of signals that outputs predict; others are
        predicted from the previous sample. References and disturbances are samples at t, or with a
        preview (N+1, *shape) and (N, *shape). A failure is reported in the status; the returned
        control is then the previous one within its limits. Raises ValueError for names and shapes
        that the problem does not have.
        """
        # before it is measured: a measurement that is not finite is taken back
        problem, before = self.problem, self._memory.known
        self._memory.measure(x or {})
        coming = self._coming(problem.disturbances, disturbances or {}, problem.horizon)
        wanted = self._coming(problem.references, references or {}, problem.horizon + 1)
        now = {name: samples[0] for name, samples in coming.items()}
        self._memory.begin(now | by_sample(problem.controls, self._resting()))
        # limits read references alone; of a state that nobody knows no rate is kept
        nobody = Given(np.full(problem.states.size, np.nan), coming, wanted)
        with np.errstate(all="ignore"):
            limits = self._functions.limits(nobody)
        met = limits.without_unmet()
        held = ControlRange(self._functions, met, nobody.state)
        if not self._memory.is_complete:
            return self._kept(Status.NOT_INITIALISED, held)
        given = replace(nobody, state=self._memory.vector())
        if not _is_finite(given):
            # a NaN that stayed in the memory would refuse every later sample too
            self._memory.restore(before)
            return self._held(held)
        if not limits.are_numbers:
            return self._held(held)
        allowed = ControlRange(self._functions, met, given.state)
        if not (allowed.is_possible and limits.can_be_met):
            found = self._kept(Status.INFEASIBLE, allowed)
        else:
            found = self._told(given, allowed, self._method.solve(given, allowed, self._resting()))
        # also what a failure returns is applied, and the next sample begins from it
        self._applied = _joined(problem.controls, found.control, "control")
        self._memory.advance(given, self._applied)
        return found

    def residuals(self, solution: Solution) -> Residuals:
        """The residuals of a solution's optimality conditions, computed independently of the
        solver.

        Raises ValueError for a solution without a plan.
        """
        if solution.given is None or solution.plan is None or solution.multipliers is None:
            raise ValueError("the solution has no plan")
        self._judge = self._judge or Judge(self.problem)
        return self._judge.residuals(solution.given, solution.plan, solution.multipliers)

    def casadi(
        self, solver: Literal["ipopt", "fatrop"] = "ipopt", options: Mapping[str, Any] | None = None
    ) -> OptimalControlNlp:
        """The same problem for a solver of CasADi, for comparisons; `options` are passed to it.
        Raises ImportError without CasADi.

            nlp = controller.casadi("fatrop")
            print(nlp.solve(found.given, found.plan).cost, found.cost)
        """
        from msnn.features.control.casadi.control_program import OptimalControlNlp

        return OptimalControlNlp(self.problem, solver, options)

    # ---- one solve

    def _told(self, given: Given, allowed: ControlRange, found: Found) -> Solution:
        problem = self.problem
        if found.status is Status.INFEASIBLE:
            return self._kept(Status.INFEASIBLE, allowed, found)
        plan = found.plan
        cost, excess = self._functions.cost(allowed.limits, found.values)
        return Solution(
            status=found.status,
            control=by_sample(problem.controls, plan.controls[0]),
            controls=by_name(problem.controls, plan.controls),
            states=by_name(problem.states, plan.states),
            cost=cost,
            residual=found.residual,
            violation=found.violation,
            excess=excess,
            iterations=found.iterations,
            given=given,
            plan=plan,
            multipliers=found.multipliers,
        )

    def _held(self, allowed: ControlRange) -> Solution:
        """The solution for refused inputs. It clips the previous control again, as limits may have
        changed since it was applied.
        """
        found = self._kept(Status.INPUT_NOT_FINITE, allowed)
        if self._applied is not None:
            self._applied = _joined(self.problem.controls, found.control, "control")
        return found

    def _kept(self, status: Status, allowed: ControlRange, found: Found | None = None) -> Solution:
        """The solution with this status that holds the previous control, clipped to its own limits.
        `found` is a plan that failed; its residual and iterations are reported.
        """
        # the range is in units of the scales
        resting, scale = self._resting(), self._functions.scale_u
        first = allowed.first(resting / scale)
        # a control that stays is the same to the bit
        control = np.where(first == resting / scale, resting, first * scale)
        held = by_sample(self.problem.controls, control)
        n = self.problem.horizon
        return Solution(
            status=status,
            control=held,
            controls={name: np.repeat(value[None], n, axis=0) for name, value in held.items()},
            # no number of a plan is left by which it could be compared
            states={},
            cost=np.nan,
            residual=np.inf if found is None else _or_infinite(found.residual),
            violation=np.inf if found is None else _or_infinite(found.violation),
            excess=np.inf,
            iterations=0 if found is None else found.iterations,
            given=None,
            plan=None,
            multipliers=None,
        )

    def _resting(self) -> Array:
        """The applied control (nu), or before there is one 0, clipped to constant limits."""
        if self._applied is not None:
            return self._applied
        return self._functions.resting

    def _coming(
        self, vector: Vector, given: Mapping[str, ArrayLike], previewed: int
    ) -> dict[str, Array]:
        """The samples of each quantity along the horizon: those `given`, of which previews have
        `previewed` samples, then the last one repeated. Raises ValueError for missing or unknown
        names and other shapes.
        """
        names = [member.name for member in vector.members]
        if {*given} != {*names}:
            kind = {"d": "disturbances", "r": "references"}[vector.letter]
            raise ValueError(f"{kind} wanted for {sorted(names)}, given for {sorted(given)}")
        found: dict[str, Array] = {}
        for name in names:
            signal = self.problem.program.signal(name)
            shape = _shape(signal)
            array = np.asarray(given[name], np.float64)
            wanted = (previewed, *shape) if name in self.problem.previewed else shape
            if array.shape != wanted:
                raise ValueError(f"`{name}` has shape {array.shape}, not {wanted}")
            samples = array if name in self.problem.previewed else array[None]
            # windows that look ahead of the last stage have samples too
            rows = self.problem.horizon + 1 + self._functions.ahead
            rest = np.repeat(samples[-1:], rows - len(samples), axis=0)
            found[name] = np.concatenate([samples, rest])
        return found


def by_sample(vector: Vector, values: Array) -> dict[str, Array]:
    """Splits a vector (size) into arrays by the names of its quantities."""
    return {name: array[0] for name, array in by_name(vector, values[None]).items()}


def _joined(vector: Vector, values: Mapping[str, ArrayLike], what: str) -> Array:
    names = [member.name for member in vector.members]
    if {*values} != {*names}:
        raise ValueError(f"{what} wanted for {sorted(names)}, given for {sorted(values)}")
    parts: list[Array] = []
    for member in vector.members:
        array = np.asarray(values[member.name], np.float64)
        shape = Type(member.axes).shape
        if array.shape != shape:
            raise ValueError(f"`{member.name}` has shape {array.shape}, not {shape}")
        parts.append(array.ravel())
    return np.concatenate(parts)


def _shape(signal: Signal) -> tuple[int, ...]:
    return Type(signal.axes).shape


def _is_finite(given: Given) -> bool:
    arrays = (given.state, *given.disturbances.values(), *given.references.values())
    return all(bool(np.all(np.isfinite(array))) for array in arrays)


def _or_infinite(number: float) -> float:
    return float(number) if np.isfinite(number) else np.inf


class Memory:
    """The states of the plant by name: each is measured, predicted from the previous sample, or
    unknown.
    """

    def __init__(self, problem: ControlProblem) -> None:
        self._problem = problem
        # nothing but next states is computed from sample to sample
        self._interpreter = Interpreter(replace(problem.program, outputs=()))
        self._registers = problem.registers
        self._shapes = {m.name: Type(m.axes).shape for m in problem.states.members}
        self._known: dict[str, Array] = {}
        self.forget()

    def forget(self) -> None:
        """Restores the memory before the first sample: only states with an initial value that needs
        no log are known.
        """
        program = self._problem.program
        alone = [s for s in program.states if not reads_log(program.start, s.start)]
        # a register begins with the first sample of its signal, once that is known (R13)
        alone = [state for state in alone if state.name not in self._registers]
        start = Interpreter(replace(program, states=tuple(alone), outputs=()))
        self._known = {name: value[0] for name, value in start.start({}, 0).items()}

    @property
    def is_complete(self) -> bool:
        return self._known.keys() == self._shapes.keys()

    @property
    def known(self) -> Mapping[str, Array]:
        """A copy of the known values by name, whose arrays are never changed later."""
        return dict(self._known)

    def restore(self, known: Mapping[str, Array]) -> None:
        """Replaces values that are not finite by those in `known`, an earlier copy; others become
        unknown.
        """
        for name, value in tuple(self._known.items()):
            if np.all(np.isfinite(value)):
                continue
            del self._known[name]
            if name in known:
                self._known[name] = known[name]

    def measure(self, values: Mapping[str, ArrayLike]) -> None:
        """Stores measured values at t, by name: of states, and of signals that outputs predict.

        The first sample fills a shift register without values completely. Raises ValueError for an
        unknown name and another shape.
        """
        fed = {o.signal: n for n, o in self._registers.items() if isinstance(o, Tape)}
        for name, value in values.items():
            # the newest part of a tape is what outputs predicted: measured samples replace it
            array = np.asarray(value, np.float64)
            if name in self._shapes:
                self._known[name] = _of_shape(name, array, self._shapes[name])
            elif name in fed:
                tape = fed[name]
                origin, shape = self._registers[tape], self._shapes[tape]
                assert isinstance(origin, Tape)
                sample = _of_shape(name, array, shape[:-1])
                register = self._known.get(tape)
                if register is None:
                    register = np.repeat(sample[..., None], shape[-1], axis=-1)
                # the tape ends with the sample t + ahead − 1
                at = max(shape[-1] - origin.ahead, 0)
                register = register.copy()
                register[..., at] = sample
                self._known[tape] = register
            else:
                known = sorted({*self._shapes, *fed} - {*fed.values()})
                raise ValueError(f"no state or fed-back signal `{name}`; there are {known}")

    def begin(self, samples: Mapping[str, Array]) -> None:
        """Fills shift registers without values by the samples of their signals at t."""
        for name, origin in self._registers.items():
            if name not in self._known and isinstance(origin, History) and origin.source in samples:
                sample = samples[origin.source]
                length = self._shapes[name][-1]
                self._known[name] = np.repeat(sample[..., None], length, axis=-1)

    def vector(self) -> Array:
        """The state x (nx). All states must be known (`is_complete`); else raises KeyError."""
        parts = [np.ravel(self._known[m.name]) for m in self._problem.states.members]
        return np.concatenate([*parts, np.empty(0)])

    def advance(self, given: Given, controls: Array) -> None:
        """Predicts the states at t+1 for these controls (nu), from the state and the disturbances
        in `given`.
        """
        # one row is stepped, but the log has the shape of a horizon
        log = log_of(self._problem, given, np.tile(controls, (self._problem.horizon, 1)))
        states = by_name(self._problem.states, given.state[None])
        found = self._interpreter.step(log, 0, states, losses=False).next_states
        self._known = {name: value[0] for name, value in found.items()}


def _of_shape(name: str, value: Array, shape: tuple[int, ...]) -> Array:
    if value.shape != shape:
        raise ValueError(f"`{name}` has shape {value.shape}, not {shape}")
    return value
