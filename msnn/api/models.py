"""Loads, compiles, steps, linearises, controls and exports one model."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from compiler.elaboration.compile import compile_spec
from compiler.ir.program import Program
from msnn.data.dataset import FloatArray
from msnn.model.load import load_model
from msnn.model.model import Model
from msnn.model.model_data import known_in, sources_of
from msnn.model.weights.given_weights import Weights
from msnn.packages import TORCH
from spec_schema.diagnostics.diagnostic import Findings, SpecError
from spec_schema.reading.python_values import Settings, setting_texts, spec_text
from spec_schema.sections.spec import Spec

OF_TEXT, OF_MAPPING = Path("text.msnn.yaml"), Path("mapping.msnn.yaml")
"""What diagnostics and runs call specs that stand in no file."""

if TYPE_CHECKING:
    from backends.torch_module.step_module import StepModule
    from msnn.features.control.kalman.kalman_filter import KalmanFilter
    from msnn.features.control.run.controller import Controller
    from msnn.features.control.run.estimation.moving_horizon import MovingHorizon
    from msnn.features.control.run.method import Solver
    from msnn.simulation.linearize import Linearization
    from msnn.stepping.stepper import Stepper


def load(spec: str | Path | Mapping[str, object], settings: Settings = ()) -> Model:
    """The model in a spec or program file, in the text of a spec, or in a mapping.

        model = msnn.load("plant.msnn.yaml")
        print(model.program.outputs)

        for window in (5, 10, 20):
            model = msnn.load("plant.msnn.yaml", {"layers.h.fir.window": window})

    A string with a line end is text; files that it or a mapping names are looked for from the
    current folder. `settings` replace values: a mapping, or `["train.0.epochs=5"]`. Raises
    SpecError with everything that is wrong, TypeError for values that no spec can hold.
    """
    texts = setting_texts(settings)
    if isinstance(spec, Mapping):
        return load_model(OF_MAPPING, texts, text=spec_text(spec))
    # no path has a line end, and no spec of one line says anything
    if isinstance(spec, str) and "\n" in spec:
        return load_model(OF_TEXT, texts, text=spec)
    return load_model(spec, texts)


def compile(spec: str | Path | Mapping[str, object] | Spec) -> Program:
    """The program of a spec, in window form.

        program = msnn.compile("plant.msnn.yaml")

    Raises SpecError with everything that is wrong with it, ValueError for a Spec with sub-models:
    these are found beside its file.
    """
    return compile_spec(spec).program if isinstance(spec, Spec) else load(spec).program


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


def torch_module(
    model: Model, weights: Weights | None = None, *, device: str = "cpu"
) -> StepModule:
    """One step of the model as a `torch.nn.Module` in memory, through which gradients flow.

        module = msnn.torch_module(model, result.weights)
        state = module.initial_state(windows)
        outputs, state = module(inputs, state)
        msnn.export(model, "c", "firmware", module)

    It does what `msnn.export(model, "torch", …)` would write, with what `export: {torch: …}` of the
    spec says of `close`, `outputs` and `dtype`. Tensors have the batch first; `msnn show
    --interface` lists ports with their shapes. `device` as in `train`. Weights None: the initial
    values. Raises SpecError, MissingExtraError.
    """
    TORCH.require("computes in torch modules")
    import torch

    from backends.torch_module.step_module import StepModule
    from msnn.exports.export import plan_exports
    from msnn.training.engines.devices import find_device

    findings = Findings()
    known = known_in(model, weights)
    plans = plan_exports(model, ["torch"], findings)
    if findings.failed:
        raise SpecError(findings.in_order, model.sources)
    # one target was asked for
    (plan,) = plans
    dtype = {"float32": torch.float32, "float64": torch.float64}[plan.float_type]
    module = StepModule(plan.program, dtype, find_device(device).torch)
    names = {parameter.name for parameter in plan.program.parameters}
    # what the outputs of the export do not need is no parameter of it
    module.model.load_physical({name: known[name] for name in names})
    return module


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
    from msnn.features.control.run.open_controller import open_controller

    known = known_in(model, weights)
    with sources_of(model):
        return open_controller(model, known, solver)


def estimator(
    model: Model, weights: Weights | None = None, *, solver: Solver | None = None
) -> KalmanFilter | MovingHorizon:
    """The estimator of states and parameters that the spec's `estimator` section describes.

        kalman = msnn.estimator(model, result.weights)
        kalman.reset({"level": 4.0, "leak": 0.0})
        found = kalman.correct({"level": 4.1})
        kalman.predict({"pump": 3.0})

    It remembers what it found; NaN is a measurement that is not there. Moving-horizon estimation
    (`mhe`) solves its window as `mpc` does its horizon, and `solver` is as there. Weights None: the
    initial values. Raises ValueError for a model without that section.
    """
    from msnn.features.control.run.open_controller import open_estimator

    known = known_in(model, weights)
    with sources_of(model):
        return open_estimator(model, known, solver)


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
    # `all` is a name, too
    names, _ = writable_targets([target], model.spec.export, sections=model.problems)
    plans = plan_exports(model, names, findings, weights=known)
    if findings.failed:
        raise SpecError(findings.in_order, model.sources)
    with sources_of(model):
        written = [write_export(plan, known, Path(folder)) for plan in plans]
    return tuple(path for export in written for path in export.files)
