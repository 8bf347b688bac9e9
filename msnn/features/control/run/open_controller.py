"""Makes the predictive controller and the estimator of a model with its weights."""

from __future__ import annotations

import os
import warnings
from collections.abc import Mapping
from functools import partial

from backends.files.c_compiler import CompilerMissingError
from msnn.data.dataset import FloatArray
from msnn.features.control.errors import export as predictive_control
from msnn.features.control.kalman_filter import KalmanFilter
from msnn.features.control.problem.optimal_control import ControlProblem
from msnn.features.control.problem.state_estimation import EstimationProblem
from msnn.features.control.problem.trained import trained
from msnn.features.control.run.controller import Controller
from msnn.features.control.run.interior_point.horizon_functions import HorizonFunctions
from msnn.features.control.run.method import Method, Solver
from msnn.features.control.run.moving_horizon import MovingHorizon
from msnn.features.control.run.reference_method import ReferenceMethod
from msnn.model.model import Model
from msnn.simulation.engines.kernel_check import NO_FALLBACK
from spec_schema.diagnostics.diagnostic import SpecError, describe


def open_controller(
    model: Model, weights: Mapping[str, FloatArray], solver: Solver | None = None
) -> Controller:
    """The controller of the model's `mpc` section with these weights (physical values by name).

    It solves by generated C code if a compiler is available, else in Python with a RuntimeWarning;
    `solver` (`c` or `python`) chooses one. Raises ValueError without the section, and SpecError if
    `c` is requested and cannot be compiled.
    """
    control = model.of(ControlProblem)
    if control is None:
        raise ValueError(f"the spec of `{model.name}` has no `mpc` section")
    known = {parameter.name for parameter in control.program.parameters}
    # a controller's program reads some parameters of the model, and refuses the others
    problem = trained(control, {n: w for n, w in weights.items() if n in known})
    functions = HorizonFunctions(problem)
    return Controller(problem, functions, _method(model, problem, functions, solver))


def _method(
    model: Model, problem: ControlProblem, functions: HorizonFunctions, solver: Solver | None
) -> Method:
    reference = ReferenceMethod(problem, functions)
    if solver == "python":
        return reference
    try:
        # jinja2 and the emitter are loaded only where something is compiled
        from msnn.features.control.run.compiled_method import CompiledMethod

        return CompiledMethod(problem, functions)
    except CompilerMissingError as error:
        reason = str(error)
    # whatever keeps C from being compiled: a controller that answers late is better than none,
    # where nobody asked for C
    except Exception as error:
        # in tests that would hide a fault of the emitter
        if os.environ.get(NO_FALLBACK):
            raise
        reason = f"{type(error).__name__}: {str(error).strip()}".partition("\n")[0]
    if solver == "c":
        raise SpecError([predictive_control.nothing_compiles(reason)], model.sources)
    said = describe(predictive_control.solved_in_python(reason))
    warnings.warn(said, RuntimeWarning, stacklevel=4)
    return reference


def open_estimator(
    model: Model, weights: Mapping[str, FloatArray], solver: Solver | None = None
) -> KalmanFilter | MovingHorizon:
    """The estimator of the model's `estimator` section with these weights (physical values by
    name).

    Moving-horizon estimation solves as controllers do, and has their errors; `solver` as for
    `open_controller`. Raises ValueError without the section.
    """
    estimation = model.of(EstimationProblem)
    if estimation is None:
        raise ValueError(f"the spec of `{model.name}` has no `estimator` section")
    if estimation.window is None:
        return KalmanFilter(estimation, weights)
    return MovingHorizon(estimation, weights, partial(_method, model, solver=solver))
