"""Trains and evaluates several models on the same rows, and ranks them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

from msnn.data.reading.frames import Frames
from msnn.features.comparison.errors import (
    grid_of_a_search,
    nothing_proposed,
    set_and_swept,
    swept_twice,
)
from msnn.features.comparison.local_workers import Waiting, outcomes
from msnn.features.comparison.proposals import Proposals, search_of
from msnn.features.comparison.ranking import (
    Criterion,
    Ranked,
    Way,
    chosen_criterion,
    common_ways,
    named_criterion,
    ranked,
)
from msnn.features.comparison.readings import Readings
from msnn.features.comparison.trial import (
    Setup,
    Trial,
    TrialLists,
    TrialOutcome,
    log_outcome,
    missing_tools,
    planned,
    run_trial,
)
from msnn.features.comparison.variants import NO_DRAWS, Draws, GridAxis, Variant, variants
from msnn.model.load import load_model
from msnn.model.model import PROGRAM_SUFFIX
from msnn.model.saved_run import run_of
from msnn.training.engines.devices import require_what_trains, slow_modules
from msnn.training.ranks.torchrun import refuse_several_processes
from msnn.training.records.run_log import LOG, RunLine, append, read
from spec_schema.diagnostics.diagnostic import SpecError
from spec_schema.reading.reader import read_spec
from spec_schema.reading.setting_values import one_path


@dataclass(frozen=True, slots=True, kw_only=True)
class ComparisonOptions:
    """The options of a comparison, as `msnn compare` and `msnn sweep` have them."""

    settings: Sequence[str] = ()
    """Values overridden in all specs."""
    draws: Draws = NO_DRAWS
    """Values drawn at random, in addition to those of the grid."""
    data: Frames | None = None
    data_root: Path | None = None
    held_out: str = "val"
    """The set for the comparison; with folds, always the held-out fold."""
    seeds: int = 1
    """Number of trainings per variant: first from the spec's initial values, then from random
    ones.
    """
    folds: bool = False
    runs: Path | None = Path("runs")
    jobs: int = 1
    ray: str | None = None
    """The address of a Ray cluster for the trainings instead of local processes."""
    optuna: str | None = None
    """Storage of the Optuna study that proposes values."""
    criterion: str | None = None
    """`fit`, `x_next.fit` or `x_next.fit:record`; None: metric of the first `validate` entry."""
    counts_cost: bool = True


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """The result of a comparison: models ordered by their accuracy on held-out rows."""

    criterion: Criterion
    ways: tuple[Way, ...]
    """The measurements that all models have in common."""
    entries: tuple[Ranked, ...]
    folder: Path | None
    """The folder of the runs and the log."""
    uncounted: tuple[str, ...]
    """Missing packages for counting instructions."""
    draws: Draws
    """The drawn values, and their seed."""

    @property
    def best(self) -> Ranked | None:
        """The most accurate model; None if no training was completed."""
        return next((entry for entry in self.entries if entry.is_best), None)


class Listener(Protocol):
    """A receiver of events: `began` with the number of trainings, then `ended` for each training
    when its outcome is known.
    """

    def began(self, trials: int) -> None: ...

    def ended(self, trial: Trial, outcome: TrialOutcome) -> None: ...


class Unheard:
    """A receiver that ignores all events."""

    def began(self, trials: int) -> None:
        del trials

    def ended(self, trial: Trial, outcome: TrialOutcome) -> None:
        del trial, outcome


def compare(
    specs: Sequence[Path],
    grid: Sequence[GridAxis],
    options: ComparisonOptions,
    listener: Listener | None = None,
) -> Comparison:
    """Trains every spec with every choice of `grid`, once per seed and fold, and ranks the models
    by a common metric.

    A logged training with the same model, data, seed and fold is not repeated, and a killed one
    continues. Raises SpecError before training for errors in specs, grid and options and for a
    criterion that is not measured, MissingExtraError for a missing package or compiler,
    TrainingInterruptedError at an interrupt. Raises SpecError afterwards if the models have no
    measurement in common.
    """
    heard = listener or Unheard()
    refuse_several_processes()
    _refuse_twice(grid, options)
    drawn = options.draws.drawn if options.optuna is None else options.draws.each_choice
    compared = variants(specs, grid, options.settings, drawn)
    # every choice once before the first training: a mistake in the last of 500 is no news after
    # hours
    modules: set[str] = set()
    for variant in _one_of_each_choice(compared, options.draws.numbers):
        if run_of(variant.spec) is not None or variant.spec.name.endswith(PROGRAM_SUFFIX):
            stages = load_model(variant.spec, variant.settings).spec.train
        else:
            stages = read_spec(variant.spec, settings=variant.settings).spec.train
        require_what_trains(stages)
        # what workers import before they are forked: torch once, not in each of them
        modules |= slow_modules(stages)
    if options.criterion is not None:
        first = {variant.spec: variant for variant in reversed(compared)}
        for variant in first.values():
            model = load_model(variant.spec, variant.settings)
            # planned, as nothing is measured yet: a typing error is told before hours of training
            named_criterion(planned(model), options.criterion)
    # looked for once, or each of hundreds of trainings would miss the same tool
    missing = missing_tools() if options.counts_cost else ()
    setup = Setup(
        data=options.data,
        data_root=options.data_root,
        held_out=options.held_out,
        runs=options.runs,
        counts_cost=options.counts_cost and not missing,
    )
    lists = TrialLists(options.seeds, options.folds)
    proposals, trials = None, lists.of(compared)
    waiting, count = Waiting(trials), len(trials)
    if options.optuna is not None:
        asked = (options.optuna, options.draws, options.criterion, setup, lists)
        # what is proposed next depends on what came out: the list is never whole
        proposals, trials = Proposals(search_of(compared[0], *asked), lists), []
        waiting = Waiting((), proposals.more)
        count = options.draws.count * len(lists.of(compared[:1]))
    log = None if options.runs is None else options.runs / LOG
    # later lines win: one that was completed by its cost stands behind the first
    known = {} if log is None else {line.key: line for line in read(log)}
    lines: dict[Variant, list[RunLine]] = {trial.variant: [] for trial in trials}
    ran: dict[str, Trial] = {}
    heard.began(count)
    if options.ray is not None:
        from msnn.features.comparison.ray_workers import ray_outcomes

        running = ray_outcomes(waiting, setup, known, options.ray)
    else:
        # no more processes than there is work
        running = outcomes(waiting, setup, known, min(options.jobs, count), sorted(modules))
    # an exception here ends the generator at its yield, and with it the processes
    with closing(running) as ended:
        for trial, outcome in ended:
            line = outcome.line
            if log is not None and not outcome.is_logged and line != known.get(line.key):
                log_outcome(log, line)
            lines.setdefault(trial.variant, []).append(line)
            if proposals is not None:
                proposals.ended(trial, line)
            heard.ended(trial, outcome)
            ran[line.key] = trial
    for found in lines.values():  # as they ended: the table says the same of the same log
        found.sort(key=lambda line: (line.seed, line.fold or 0))
    # only the first seed is costed while trainings run: all of a variant have the same operations
    for found in lines.values() if setup.counts_cost else ():
        _cost_another(found, ran, setup, log)
    return _judged(lines, options, tuple(tool.package for tool in missing))


def _cost_another(
    lines: list[RunLine], ran: Mapping[str, Trial], setup: Setup, log: Path | None
) -> None:
    """Measures the C code with the weights of another training of a variant if the training meant
    for that was not completed.

    `lines` are the log lines of the variant, in which the costed one is replaced; `ran` are the
    trials by key. The line is also appended to `log`, if there is one.
    """
    ended = [line for line in lines if line.state == "finished"]
    if not ended or any(line.cost is not None for line in ended):
        return
    first = ended[0]
    trial = replace(ran[first.key], is_costed=True)
    readings = Readings(setup.data, setup.data_root)
    line = run_trial(trial, setup, {first.key: first}, readings).line
    if line != first:
        lines[lines.index(first)] = line
        if log is not None:
            append(log, line)


def _judged(
    lines: Mapping[Variant, Sequence[RunLine]],
    options: ComparisonOptions,
    uncounted: tuple[str, ...],
) -> Comparison:
    ended = [line for found in lines.values() for line in found if line.state == "finished"]
    criterion = chosen_criterion(ended, options.criterion)
    return Comparison(
        criterion=criterion,
        ways=common_ways(ended),
        entries=ranked(lines, criterion),
        folder=options.runs,
        uncounted=uncounted,
        draws=options.draws,
    )


def _refuse_twice(grid: Sequence[GridAxis], options: ComparisonOptions) -> None:
    """Raises SpecError if every value of an axis is overridden by a later axis, or a setting by an
    axis. Raises it also for Optuna with a grid, or without a value to propose.

    Overriding a part of an earlier value is allowed: `data.split={…}`, then `data.split.k`.
    """
    swept = [axis.path for axis in (*options.draws.axes, *grid)]
    for number, path in enumerate(swept):
        if any(_replaces(later, path) for later in swept[number + 1 :]):
            raise SpecError((swept_twice(path),))
    for path in (one_path(setting.partition("=")[0]) for setting in options.settings):
        by = next((axis for axis in swept if _replaces(axis, path)), None)
        if by is not None:
            raise SpecError((set_and_swept(path, by),))
    # Optuna proposes each value: a grid beside it would be trained once for every proposal
    if options.optuna is not None and grid:
        raise SpecError((grid_of_a_search(grid[0].path),))
    if options.optuna is not None and not options.draws.axes:
        raise SpecError((nothing_proposed(),))


def _replaces(later: str, path: str) -> bool:
    # a setting of a table replaces all that is below it
    return path == later or path.startswith(f"{later}.")


def _one_of_each_choice(compared: Sequence[Variant], drawn: frozenset[str]) -> list[Variant]:
    """The variants that add a spec or a setting not seen before, so that errors are found early.

    Keys in `drawn` have values between bounds: the first value represents all of them.
    """

    def choice(setting: str) -> str:
        path = setting.partition("=")[0]
        return path if path in drawn else setting

    seen: set[tuple[Path, str]] = set()
    found: list[Variant] = []
    for variant in compared:
        choices = {(variant.spec, choice(setting)) for setting in (*variant.settings, "")}
        if not choices <= seen:
            seen |= choices
            found.append(variant)
    return found
