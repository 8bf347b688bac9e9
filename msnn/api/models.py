"""Loads, compiles, steps, linearises, controls, exports and imports one model."""

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
from msnn.model.weights.weights_file import Weights
from msnn.packages import TORCH
from spec_schema.diagnostics.diagnostic import Findings, SpecError
from spec_schema.reading.setting_values import Settings, setting_texts, spec_text
from spec_schema.sections.spec import Spec

if TYPE_CHECKING:
    from backends.torch_module.step_module import StepModule
    from msnn.features.control.kalman_filter import KalmanFilter
    from msnn.features.control.run.controller import Controller
    from msnn.features.control.run.method import Solver
    from msnn.features.control.run.moving_horizon import MovingHorizon
    from msnn.features.nnodely.import_model import WrittenImport
    from msnn.simulation.linearize import Linearization
    from msnn.stepping import Stepper


OF_TEXT, OF_MAPPING = Path("text.msnn.yaml"), Path("mapping.msnn.yaml")
"""Names of specs without a file, in diagnostics and runs."""


def load(spec: str | Path | Mapping[str, object], settings: Settings = ()) -> Model:
    """The model in a spec or program file, in the text of a spec, or in a mapping.

        model = msnn.load("plant.msnn.yaml")
        print(model.program.outputs)

        for window in (5, 10, 20):
            model = msnn.load("plant.msnn.yaml", {"layers.h.fir.window": window})

    A string with a line break is the text of a spec. Files named in a text or mapping are relative
    to the current folder. `settings` override values: a mapping, or `["train.0.epochs=5"]`. Raises
    SpecError with all errors, and TypeError for values that no spec can contain.
    """
    texts = setting_texts(settings)
    if isinstance(spec, Mapping):
        return load_model(OF_MAPPING, texts, text=spec_text(spec))
    # no path has a line end, and no spec of one line says anything
    if isinstance(spec, str) and "\n" in spec:
        return load_model(OF_TEXT, texts, text=spec)
    return load_model(spec, texts)


def compile(spec: str | Path | Mapping[str, object] | Spec) -> Program:
    """Compiles a spec to a program.

        program = msnn.compile("plant.msnn.yaml")

    The program is in window form: a step reads past inputs as windows of the data, not from states.
    Raises SpecError with all errors in the spec, and ValueError for a Spec with sub-models, because
    their files are relative to that of the spec.
    """
    return compile_spec(spec).program if isinstance(spec, Spec) else load(spec).program


def initial_weights(model: Model) -> dict[str, FloatArray]:
    """The initial value of every parameter by name, in the units of the spec.

        weights = {**msnn.initial_weights(model), "k": 15.0}

    Every function with weights accepts values of all parameters: a mapping of arrays, numbers or
    torch tensors; a result of `train`, `train_folds` or `stage_loss`; the path of a weights file or
    of a run's folder. Raises SpecError if a value can only be computed from data.
    """
    return dict(known_in(model, None))


def linearize(
    model: Model,
    inputs: Mapping[str, ArrayLike],
    states: Mapping[str, ArrayLike],
    weights: Weights | None = None,
    hessian: Mapping[str, ArrayLike] | None = None,
) -> Linearization:
    """The Jacobians of one step with respect to states, inputs and parameters.

        found = msnn.linearize(model, {"F": 0.0}, {"x": 0.1, "v": 0.0}, result.weights)
        print(found.matrices["A"], found.vectors["x"].member("v").first)

        multipliers = {"next(v)": 1.0, "power": 0.5}
        found = msnn.linearize(model, inputs, states, result.weights, hessian=multipliers)
        print(found.hessians["xu"])

    `inputs` are samples in the shapes of ports. `states` are all states by name, buffers
    (`F.history`) with the oldest sample first; `msnn show --interface` lists both. Matrices are
    (rows, columns), in the spec's units. Weights None: the initial values. Raises ValueError.

    `hessian` adds second derivatives of the sum of outputs (by name) and next states (`next(v)`),
    each times its multiplier; omitted ones have multiplier 0. Non-finite elements are kept, and
    `found.infinite` names the matrices that contain any.
    """
    from msnn.simulation.linearize import linearize as run

    return run(model.program, inputs, states, known_in(model, weights), hessian)


def stepper(model: Model, weights: Weights | None = None) -> Stepper:
    """The model as an object with state, stepped from Python one sample at a time.

        s = msnn.stepper(model, result.weights)
        s.reset(x=0.1)
        for force in forces:
            print(s.step(F=force)["x_next"], s.state["v"])

    It uses the C code that `msnn.export(model, "c", …)` writes, compiled for this machine: the same
    values, a few microseconds per step. Any number of steppers are independent. Without a C
    compiler the interpreter is used, with a RuntimeWarning. Weights None: the initial values.
    Raises SpecError; ValueError if an input is missing, unknown or of another shape.
    """
    from msnn.stepping import open_stepper

    known = known_in(model, weights)
    with sources_of(model):
        return open_stepper(model, known)


def torch_module(
    model: Model, weights: Weights | None = None, *, device: str = "cpu"
) -> StepModule:
    """One step of the model as a differentiable `torch.nn.Module` in memory.

        module = msnn.torch_module(model, result.weights)
        state = module.initial_state(windows)
        outputs, state = module(inputs, state)
        msnn.export(model, "c", "firmware", module)

    It is equivalent to `msnn.export(model, "torch", …)`, with `close`, `outputs` and `dtype` from
    `export: {torch: …}` of the spec. Tensors have the batch as first axis; `msnn show --interface`
    lists ports with their shapes. `device` is as in `train`. Weights None: the initial values.
    Raises SpecError, MissingExtraError.
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
    """The model predictive controller of the spec's `mpc` section.

        controller = msnn.mpc(model, result.weights)
        found = controller.solve({"level": 3.0}, references={"wanted": 6.0})
        print(found.status, found.control["pump"])

    It keeps its plan and the applied control; `reset` clears both. It uses the C code that
    `msnn.export(model, "mpc", …)` writes, in float64, compiled for this machine. Without a C
    compiler it uses the reference in Python, with a RuntimeWarning. `solver="python"` always uses
    the reference, `"c"` only C; `controller.solver` is the one in use. Weights None: the initial
    values. Raises ValueError for a model without that section, and SpecError if `"c"` is not
    available.
    """
    from msnn.features.control.run.open_controller import open_controller

    known = known_in(model, weights)
    with sources_of(model):
        return open_controller(model, known, solver)


def estimator(
    model: Model, weights: Weights | None = None, *, solver: Solver | None = None
) -> KalmanFilter | MovingHorizon:
    """The estimator of states and parameters in the spec's `estimator` section.

        kalman = msnn.estimator(model, result.weights)
        kalman.reset({"level": 4.0, "leak": 0.0})
        found = kalman.correct({"level": 4.1})
        kalman.predict({"pump": 3.0})

    It keeps its estimate; NaN is a missing measurement. Moving-horizon estimation (`mhe`) solves
    its window like `mpc` its horizon, with the same `solver`. Weights None: the initial values.
    Raises ValueError for a model without that section.
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

    The spec's `export` section defines the options of the target. Weights None: the initial values.
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


def import_nnodely(file: str | Path, out: str | Path | None = None) -> WrittenImport:
    """Writes the spec and the weights of a model that nnodely 1.x saved as JSON.

        written = msnn.import_nnodely("plant.json")
        model = msnn.load(written.spec)
        (run,) = msnn.simulate(model, frames, written.weights)

    `out` is the spec, by default the file's name with the ending `.msnn.yaml`; the weights are
    written next to it. Raises SpecError if a value or relation does not have nnodely's format, if a
    function cannot be translated, or if one of the files exists.
    """
    from msnn.features.nnodely.import_model import write_import

    return write_import(Path(file), None if out is None else Path(out))
