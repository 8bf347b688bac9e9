"""Loads, compiles, steps, linearises, controls and exports one model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from compiler.elaboration.compile import compile_spec
from compiler.ir.program import Program
from msnn.data.dataset import FloatArray
from msnn.model.given_weights import Weights
from msnn.model.load import load_model
from msnn.model.model import Model
from msnn.model.model_data import known_in, sources_of
from spec_schema.diagnostics.diagnostic import Findings, SpecError
from spec_schema.sections.spec import Spec

if TYPE_CHECKING:
    from compiler.state_estimation.kalman_filter import KalmanFilter
    from msnn.control.controller import Controller
    from msnn.control.method import Solver
    from msnn.simulation.linearize import Linearization
    from msnn.stepping.stepper import Stepper


def load(path: str | Path, settings: Sequence[str] = ()) -> Model:
    """The model in a spec or program file; `settings` such as `train.0.epochs=5` replace values.

        model = msnn.load("plant.msnn.yaml")
        print(model.program.outputs)

    Raises SpecError with everything that is wrong with the file.
    """
    return load_model(path, settings)


def compile(spec: str | Path | Spec) -> Program:
    """The program of a spec, in window form.

        program = msnn.compile("plant.msnn.yaml")

    Raises SpecError with everything that is wrong with it, ValueError for a Spec with sub-models:
    these are found beside its file.
    """
    return compile_spec(spec).program if isinstance(spec, Spec) else load_model(spec).program


def initial_weights(model: Model) -> dict[str, FloatArray]:
    """The initial value of every parameter by name, in the units of the spec.

        weights = {**msnn.initial_weights(model), "k": 15.0}

    Every function that takes weights takes those of all parameters: a mapping of arrays, numbers or
    torch tensors; a result of `train`, `train_folds` or `stage_loss`; the path of a weights file or
    of the folder of a run. Raises SpecError where a value is known from data only.
    """
    return dict(known_in(model, None))


def linearize(
    model: Model,
    inputs: Mapping[str, ArrayLike],
    states: Mapping[str, ArrayLike],
    weights: Weights | None = None,
    hessian: Mapping[str, ArrayLike] | None = None,
) -> Linearization:
    """Slopes of one step in all that the model remembers, its inputs and its parameters.

        found = msnn.linearize(model, {"F": 0.0}, {"x": 0.1, "v": 0.0}, result.weights)
        print(found.matrices["A"], found.vectors["x"].member("v").first)

        multipliers = {"next(v)": 1.0, "power": 0.5}
        found = msnn.linearize(model, inputs, states, result.weights, hessian=multipliers)
        print(found.hessians["xu"])

    `inputs` are samples in the shapes of ports, `states` all that is remembered by name, buffers
    (`F.history`) oldest sample first; `msnn show --interface` lists both. Matrices are (rows,
    columns), in the spec's units. Weights None: the initial values. Raises ValueError.

    `hessian` asks for second derivatives too: of the sum of outputs (by name) and next states
    (`next(v)`), each times its multiplier; what is not named has the multiplier 0. Numbers that
    are not finite are shown as they are, and `found.infinite` names the matrices that have any.
    """
    from msnn.simulation.linearize import linearize as run

    return run(model.program, inputs, states, known_in(model, weights), hessian)


def stepper(model: Model, weights: Weights | None = None) -> Stepper:
    """The model with a memory of its own, stepped from Python a sample at a time.

        s = msnn.stepper(model, result.weights)
        s.reset(x=0.1)
        for force in forces:
            print(s.step(F=force)["x_next"], s.state["v"])

    It is what `msnn.export(model, "c", …)` would write, compiled for this machine: the same
    numbers, some microseconds a step. Any number of them are independent. Without a C compiler
    the interpreter steps, and a RuntimeWarning says so. Weights None: the initial values. Raises
    SpecError; ValueError where an input is missing, unknown or of another shape.
    """
    from msnn.stepping.open_stepper import open_stepper

    known = known_in(model, weights)
    with sources_of(model):
        return open_stepper(model, known)


def mpc(
    model: Model, weights: Weights | None = None, *, solver: Solver | None = None
) -> Controller:
    """The predictive controller that the spec's `mpc` section describes.

        controller = msnn.mpc(model, result.weights)
        found = controller.solve({"level": 3.0}, references={"wanted": 6.0})
        print(found.status, found.control["pump"])

    It remembers its plan and what it applied; `reset` forgets both. It solves by the C that
    `msnn.export(model, "mpc", …)` would write, in float64, compiled for this machine; without a C
    compiler by the reference in Python, and a RuntimeWarning says so. `solver="python"` takes that
    at once, `"c"` nothing else; `controller.solver` tells which. Weights None: the initial values.
    Raises ValueError for a model without that section, SpecError where `"c"` is not to be had.
    """
    from msnn.control.open_controller import open_controller

    known = known_in(model, weights)
    with sources_of(model):
        return open_controller(model, known, solver)


def estimator(model: Model, weights: Weights | None = None) -> KalmanFilter:
    """The estimator of states and parameters that the spec's `estimator` section describes.

        kalman = msnn.estimator(model, result.weights)
        kalman.reset({"level": 4.0, "leak": 0.0})
        found = kalman.correct({"level": 4.1})
        kalman.predict({"pump": 3.0})

    It remembers what it found; NaN is a measurement that is not there. Weights None: the initial
    values. Raises ValueError for a model without that section.
    """
    from msnn.control.open_controller import open_estimator

    return open_estimator(model, known_in(model, weights))


def export(
    model: Model,
    target: str,
    folder: str | Path = "build/export",
    weights: Weights | None = None,
) -> tuple[Path, ...]:
    """Writes one target, by its name on the command line, and returns the paths of its files.

        msnn.export(model, "c", "firmware/plant", result.weights)

    What the spec's `export` section says of the target holds. Weights None: the initial values.
    Raises SpecError, MissingExtraError, OSError.
    """
    from msnn.exports.export import plan_exports, writable_targets, write_export

    findings = Findings()
    known = known_in(model, weights)
    names, _ = writable_targets([target], model.spec.export, is_online=model.is_online)
    plans = plan_exports(model, names, findings, weights=known)
    if findings.failed:
        raise SpecError(findings.in_order, model.sources)
    with sources_of(model):
        written = [write_export(plan, known, Path(folder)) for plan in plans]
    return tuple(path for export in written for path in export.files)
