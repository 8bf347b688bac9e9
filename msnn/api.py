"""The verbs as Python functions: what `import msnn` offers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from compiler.elaboration.compile import compile_spec
from compiler.ir.program import Program
from compiler.passes.close_loop import LoopError
from msnn.data.dataset import Dataset, FloatArray
from msnn.model.given_weights import Weights
from msnn.model.load import load_model
from msnn.model.model import Model
from msnn.model.model_data import data_folder, given_in, known_in, measured, sources_of
from spec_schema.diagnostics.diagnostic import Findings, SpecError
from spec_schema.sections.spec import Spec

if TYPE_CHECKING:
    from msnn.comparison.compare import Comparison, Listener
    from msnn.data.reading.frames import Frames
    from msnn.simulation.engines.progress import RolloutProgress
    from msnn.simulation.linearize import Linearization
    from msnn.simulation.simulate import Simulations
    from msnn.simulation.simulation_data import GivenData
    from msnn.stepping.stepper import Stepper
    from msnn.training.folds import FoldsResult
    from msnn.training.records.progress import Progress
    from msnn.training.records.training_options import TrainingOptions
    from msnn.training.stage_loss_module import StageLoss
    from msnn.training.training_result import TrainingResult
    from msnn.validation.validate import ValidationReport


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


def train(
    model: Model,
    data: Frames | None = None,
    *,
    data_root: str | Path | None = None,
    runs: str | Path | None = "runs",
    resume: bool = False,
    tensorboard: bool = False,
    device: str = "cpu",
    weights: Weights | None = None,
    progress: Progress | None = None,
) -> TrainingResult:
    """Trains the stages of a spec on its data and returns the best weights of the last.

        result = msnn.train(msnn.load("plant.msnn.yaml"))
        print(result.weights["k"], result.folder)

    `data` are frames of pandas or polars or mappings of arrays, with the columns that the spec
    names, one a record: a single one, a list, or either for each set, `{"train": a, "val": b}`.
    None takes the data of the spec. `runs` None keeps no files; `tensorboard` adds curves to them.
    `device` is where torch computes: cpu, cuda, cuda:N or auto; `weights` is where the first stage
    begins, by default the initial values. Raises SpecError, TrainingDivergedError,
    TrainingInterruptedError and MissingExtraError.
    """
    from msnn.training import train as engine
    from msnn.training.run_line import begun, diverged, ended, log

    options = replace(_options(model, runs, tensorboard, device), resume=resume)
    first = given_in(model, weights)
    dataset = measured(model, data, data_root, "training")
    line = begun(model, dataset)
    with sources_of(model):
        try:
            found = engine.train(model.program, dataset, model.spec.train, options, progress, first)
        except engine.TrainingDivergedError as error:
            log(options.runs, diverged(line, error))
            raise
    log(options.runs, ended(line, found, options.runs))
    return found


def train_folds(
    model: Model,
    data: Frames | None = None,
    *,
    data_root: str | Path | None = None,
    runs: str | Path | None = "runs",
    resume: bool = False,
    tensorboard: bool = False,
    device: str = "cpu",
    weights: Weights | None = None,
    progress: Progress | None = None,
) -> FoldsResult:
    """Trains once for every fold of `split: {by: kfold, k}`, and measures it on the fold.

        result = msnn.train_folds(msnn.load("plant.msnn.yaml"))
        print([fold.monitor for fold in result.folds], result.best.training.weights)

    Arguments and errors as of `train`; frames are of one set, which the folds divide. SpecError
    also where the data have no folds.
    """
    from msnn.data.reading.frames import refuse_sets
    from msnn.training import folds

    refuse_sets(data)
    options = replace(_options(model, runs, tensorboard, device), resume=resume)
    first = given_in(model, weights)

    def read(one: Model) -> Dataset:
        return measured(one, data, data_root, "training")

    with sources_of(model):
        return folds.train_folds(model, read, options, progress, first)


def stage_loss(
    model: Model,
    data: Frames | None = None,
    *,
    data_root: str | Path | None = None,
    stage: int = 0,
    device: str = "cpu",
    weights: Weights | None = None,
) -> StageLoss:
    """The loss of one stage as a torch module whose forward and backward are the kernel's.

        loss = msnn.stage_loss(model)
        optimizer = torch.optim.RAdam(loss.parameters(), lr=1e-3)
        for epoch in range(100):
            for batch in loss.batches(epoch):
                optimizer.zero_grad()
                loss(batch).backward()
                optimizer.step()
        weights = loss.weights()

    Rollouts, batches, dtype, `freeze` and loss weights are those of the stage; its optimiser,
    schedule and limits of gradients are yours. `data` and `device` as in `train`. Raises SpecError
    and MissingExtraError.
    """
    from msnn.training.engines.devices import find_device
    from msnn.training.stage_loss_module import stage_loss as opened

    place, first = find_device(device), given_in(model, weights)
    dataset = measured(model, data, data_root, "training")
    with sources_of(model):
        return opened(model.program, dataset, model.spec.train, stage, first, place)


def validate(
    model: Model,
    weights: Weights | None = None,
    data: Frames | None = None,
    *,
    data_root: str | Path | None = None,
    engine: str = "auto",
    progress: RolloutProgress | None = None,
) -> ValidationReport:
    """Measures the `validate` section of a spec in float64; None: initial weights.

        report = msnn.validate(model, result.weights)
        assert report.passed

    `data` as in `train`; entries with `files:` are measured on these all the same. `engine` is what
    simulates: `interpreter`, the judge of all others, `native` kernels, `torch`, or `auto`, kernels
    where they save time; `progress(done, total)` is told how many steps are done. Raises SpecError.
    """
    from msnn.data.reading.file_sets import load_file_sets
    from msnn.simulation.engines.open_rollouts import known_engine
    from msnn.simulation.engines.progress import nobody
    from msnn.validation import validate as validation

    engine = known_engine(engine)
    checks, dataset = model.spec.checks, None
    if not checks or any(check.files is None for check in checks):
        dataset = measured(model, data, data_root, "validation")
    known = known_in(model, weights)
    with sources_of(model):
        files = load_file_sets(model.program, model.spec, data_folder(model, data_root))
        report = validation.validate(
            model.program,
            dataset,
            checks,
            known,
            files=files,
            engine=engine,
            progress=progress or nobody,
        )
        read = [*([] if dataset is None else [dataset]), *files.values()]
        warnings = [warning for one in read for warning in one.warnings]
        return replace(report, warnings=(*warnings, *report.warnings))


def compare(
    specs: str | Path | Sequence[str | Path],
    *,
    grid: Sequence[str] = (),
    settings: Sequence[str] = (),
    data: Frames | None = None,
    data_root: str | Path | None = None,
    on: str = "val",
    seeds: int = 1,
    folds: bool = False,
    runs: str | Path | None = "runs",
    jobs: int = 1,
    by: str | None = None,
    cost: bool = True,
    listener: Listener | None = None,
) -> Comparison:
    """Trains specs, or one with every choice of a grid, and ranks them on rows held out.

        found = msnn.compare("plant.msnn.yaml", grid=["layers.h.fir.window=5,10,20"], seeds=3)
        print(found.best.variant.settings, found.best.score)

    `on` is the set that they are compared on; with `folds` each fold of `split: {by: kfold, k}` is
    held out in turn. `by` ranks them: `fit`, `x_next.fit` or `x_next.rmse:record`; None takes what
    the first entry of `validate` asks for. `jobs` trainings run at once, each in a process: a
    script then needs `if __name__ == "__main__"`. `cost` counts instructions and bytes of the C on
    a Cortex-M4F, where the tools are installed. `runs/runs.jsonl` has every training; one that is
    there is not repeated. Raises SpecError and TrainingInterruptedError.
    """
    from msnn.comparison.compare import ComparisonOptions
    from msnn.comparison.compare import compare as run
    from msnn.comparison.variants import grid_axis

    named = [specs] if isinstance(specs, str | Path) else specs
    options = ComparisonOptions(
        settings=settings,
        data=data,
        data_root=None if data_root is None else Path(data_root),
        held_out=on,
        seeds=seeds,
        folds=folds,
        runs=None if runs is None else Path(runs),
        jobs=jobs,
        criterion=by,
        counts_cost=cost,
    )
    return run(
        [Path(spec) for spec in named], [grid_axis(each) for each in grid], options, listener
    )


def initial_weights(model: Model) -> dict[str, FloatArray]:
    """The initial value of every parameter by name, in the units of the spec.

        weights = {**msnn.initial_weights(model), "k": 15.0}

    Every function that takes weights takes those of all parameters: a mapping of arrays, numbers or
    torch tensors; a result of `train`, `train_folds` or `stage_loss`; the path of a weights file or
    of the folder of a run. Raises SpecError where a value is known from data only.
    """
    return dict(known_in(model, None))


def simulate(
    model: Model,
    data: GivenData | None = None,
    weights: Weights | None = None,
    *,
    horizon: int | None = None,
    data_root: str | Path | None = None,
    data_set: str | None = None,
    engine: str = "auto",
    progress: RolloutProgress | None = None,
) -> Simulations:
    """Runs the model freely over records; every input that an output predicts is fed back.

        (run,) = msnn.simulate(model, {"F": force, "x": position}, result.weights)
        print(run.outputs["x_next"], run.logged["x_next"], run.places.rows)

    `data` are frames as in `train`, or files with the columns that the spec names; None takes the
    data of the spec. `data_set` runs over one set only; of files it says which set of the spec has
    their columns. `horizon` ends each run after so many steps. `engine` and `progress` as in
    `validate`. The answer is a sequence of runs, with `warnings`. Raises SpecError.
    """
    from msnn.exports.prepare import loop_fault
    from msnn.simulation.engines.open_rollouts import known_engine
    from msnn.simulation.engines.progress import nobody
    from msnn.simulation.simulate import simulate as run
    from msnn.simulation.simulate import simulation_program
    from msnn.simulation.simulation_data import simulation_data

    engine = known_engine(engine)
    try:
        program = simulation_program(model.program)
    except LoopError as error:
        raise SpecError([loop_fault(error, None)], model.sources) from None
    dataset = simulation_data(model, program, data, data_root, data_set)
    with sources_of(model):
        return run(
            program,
            dataset,
            known_in(model, weights),
            horizon,
            data_set,
            engine=engine,
            progress=progress or nobody,
        )


def linearize(
    model: Model,
    inputs: Mapping[str, ArrayLike],
    states: Mapping[str, ArrayLike],
    weights: Weights | None = None,
) -> Linearization:
    """Slopes of one step in all that the model remembers, its inputs and its parameters.

        found = msnn.linearize(model, {"F": 0.0}, {"x": 0.1, "v": 0.0}, result.weights)
        print(found.matrices["A"], found.vectors["x"].member("v").first)

    `inputs` are samples in the shapes of ports, `states` all that is remembered by name, buffers
    (`F.history`) oldest sample first; `msnn show --interface` lists both. Matrices are (rows,
    columns), in the spec's units. Weights None: the initial values. Raises ValueError.
    """
    from msnn.simulation.linearize import linearize as run

    return run(model.program, inputs, states, known_in(model, weights))


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


def export(
    model: Model,
    target: str,
    folder: str | Path = "build/export",
    weights: Weights | None = None,
) -> tuple[Path, ...]:
    """Writes one target, by its name on the command line, and returns the paths of its files.

        msnn.export(model, "c", "firmware/plant", result.weights)

    What the spec's `export` section says of the target holds. Weights None: the initial values.
    Raises SpecError, OSError.
    """
    from msnn.exports.export import plan_exports, target_names, write_export

    findings = Findings()
    plans = plan_exports(model, target_names([target], model.spec.export), findings)
    if findings.failed:
        raise SpecError(findings.in_order, model.sources)
    known = known_in(model, weights)
    with sources_of(model):
        written = [write_export(plan, known, Path(folder)) for plan in plans]
    return tuple(path for export in written for path in export.files)


def _options(
    model: Model, runs: str | Path | None, tensorboard: bool, device: str
) -> TrainingOptions:
    from msnn.training.engines.devices import find_device
    from msnn.training.records.training_options import options_for

    kept = None if runs is None else Path(runs)
    return options_for(model, runs=kept, tensorboard=tensorboard, device=find_device(device))
