"""Lets Optuna propose values of a spec based on earlier results."""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from msnn.features.comparison.errors import lost_study, study_in_memory, unusable_study
from msnn.features.comparison.ranking import MONITOR, Criterion, chosen_criterion, named_criterion
from msnn.features.comparison.readings import Readings
from msnn.features.comparison.trial import Setup, Trial, TrialLists, planned
from msnn.features.comparison.variants import Bounds, DrawAxis, Drawn, Draws, Variant, variants
from msnn.packages import OPTUNA
from msnn.training.records.run_log import RunLine
from msnn.training.training_result import begun
from spec_schema.diagnostics.diagnostic import SpecError

_TEXTS = "values"
"""Attribute of a study's trial for its values, as YAML."""
_IN_MEMORY = re.compile(r"(sqlite(\+\w+)?://(/|/?(?=\?)|$))?(:memory:)?(\?.*)?")
"""Matches SQLite addresses without a file."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Search:
    """A search by Optuna: the spec, the values to propose, the criterion, and the storage of its
    trials.
    """

    storage: str
    """A SQLite file, or the address of a database in SQLAlchemy's format."""
    spec: Path
    settings: Sequence[str]
    draws: Draws
    wanted: str | None
    """The criterion requested by the user."""
    is_higher_better: bool
    decided_by: Sequence[object]
    """Everything else that affects the result: model, data, seeds, folds."""


def search_of(
    one: Variant, storage: str, draws: Draws, wanted: str | None, setup: Setup, lists: TrialLists
) -> Search:
    """The search for the spec of the variant `one`, whose last settings are drawn values.

    `wanted` is the criterion requested by the user, `lists` gives seeds and folds. Raises SpecError
    for a criterion that is not measured and for errors in spec or data, MissingExtraError for a
    missing package.
    """
    readings = Readings(setup.data, setup.data_root)
    fold = lists.of([one])[0].fold
    model = readings.model(one, fold)
    line = begun(model, readings.data(one, fold), fold=fold, held_out=setup.held_out)
    measured = planned(model)
    if wanted is not None:
        metric = named_criterion(measured, wanted).metric
    else:
        metric = measured[0].asked if measured else MONITOR.metric
    return Search(
        storage=storage,
        spec=one.spec,
        # the drawn values are the last settings of a variant
        settings=one.settings[: -len(draws.axes)],
        draws=draws,
        wanted=wanted,
        is_higher_better=Criterion(None, metric).is_higher_better,
        decided_by=(line.key, lists.seeds, lists.folds),
    )


@dataclass(slots=True)
class Proposals:
    """An Optuna study: it proposes values, and learns from the results of earlier proposals.

    Creating one raises MissingExtraError without Optuna, and SpecError if the storage cannot be
    used. Proposals that an earlier command left without a result are trained again.
    """

    search: Search
    lists: TrialLists
    _study: Any = field(init=False)
    _optuna: Any = field(init=False)
    _asked: int = field(init=False, default=0)
    _open: dict[Variant, list[int]] = field(init=False, default_factory=dict[Variant, list[int]])
    """Numbers of proposals without a result, by variant; two may have equal values."""
    _ended: dict[Variant, list[RunLine]] = field(
        init=False, default_factory=dict[Variant, list[RunLine]]
    )
    _before: list[Variant] = field(init=False, default_factory=list[Variant])
    """Earlier variants of the study, to be listed with the others."""

    def __post_init__(self) -> None:
        OPTUNA.require("proposes values for `--optuna`")
        # an optional package, which brings SQLAlchemy: loaded where it is asked for
        self._optuna = import_module("optuna")
        self._optuna.logging.set_verbosity(self._optuna.logging.ERROR)
        self._study = self._opened()
        with self._kept():
            trials = self._study.get_trials(deepcopy=False)
        # a seed of its own each time: else what is proposed after a resume repeats the beginning
        seed = np.random.SeedSequence((self.search.draws.seed, len(trials))).generate_state(1)[0]
        # proposals that are still trained count as bad ones, or several workers would look in one
        # place
        self._study.sampler = self._optuna.samplers.TPESampler(seed=int(seed), constant_liar=True)
        for trial in trials:
            texts, is_over = trial.user_attrs.get(_TEXTS), trial.state.is_finished()
            if texts is None and not is_over:  # killed before it was known what it is of
                self._say(trial.number, None)
            if texts is None or self._asked == self.search.draws.count:
                continue
            self._asked += 1
            variant = self._variant(texts)
            self._before.append(variant)
            # proposed and never told, as its command ended: it is trained again
            if not is_over:
                self._open.setdefault(variant, []).append(trial.number)

    def more(self) -> Sequence[Trial]:
        """The trials of the next proposal, or of earlier proposals of the study at first. Empty if
        the study has as many proposals as requested. Raises SpecError if the storage fails.
        """
        if self._before:
            found = tuple(dict.fromkeys(self._before))
            self._before.clear()
            return self.lists.of(found)
        while self._asked < self.search.draws.count:
            self._asked += 1
            laws = {axis.path: self._law(axis) for axis in self._axes}
            with self._kept():
                # laws of this command: a study of other laws has another name
                asked = self._study.ask(laws)
            texts = [_text(axis, asked.params[axis.path]) for axis in self._axes]
            with self._kept():
                # as rounded and written, not as asked for: what was trained is what is found again
                asked.set_user_attr(_TEXTS, texts)
            variant = self._variant(texts)
            is_new = variant not in self._open and variant not in self._ended
            self._open.setdefault(variant, []).append(asked.number)
            if is_new:
                return self.lists.of([variant])
            self._tell(variant)  # the same values again: they are known, or will be
        return ()

    def ended(self, trial: Trial, line: RunLine) -> None:
        """Adds the log line of a completed trial; reports the mean to the study when all seeds and
        folds of its variant are complete. Raises SpecError if the storage fails.
        """
        self._ended.setdefault(trial.variant, []).append(line)
        self._tell(trial.variant)

    @property
    def _axes(self) -> tuple[DrawAxis, ...]:
        return self.search.draws.axes

    def _tell(self, variant: Variant) -> None:
        lines = self._ended.get(variant, [])
        # a mean of some seeds would be compared with one of all
        if len(lines) < len(self.lists.of([variant])):
            return
        score = _score(lines, self.search.wanted)
        for number in self._open.pop(variant, ()):
            self._say(number, score if math.isfinite(score) else None)

    def _say(self, number: int, score: float | None) -> None:
        """Reports the score of proposal `number` to the study, or its failure for None; a result
        that another command has reported is not replaced.
        """
        state = self._optuna.trial.TrialState
        # a diverged training says where not to look, but has no number that a sampler could use
        over = state.FAIL if score is None else state.COMPLETE
        with self._kept():
            self._study.tell(number, score, state=over, skip_if_finished=True)

    @contextmanager
    def _kept(self) -> Generator[None]:
        """A context that raises SpecError if the storage fails, e.g. by a full disk or a lost
        server.

        Used only around calls of Optuna, so that internal errors are not reported as storage
        errors.
        """
        try:
            yield
        except Exception as error:  # each database has errors of its own
            raise SpecError((lost_study(self.search.storage, _reason(error)),)) from error

    def _variant(self, texts: Sequence[str]) -> Variant:
        search = self.search
        # the same form of a variant as in a sweep without Optuna, so that its log serves both
        paths = tuple(axis.path for axis in self._axes)
        drawn = Drawn(paths, (tuple(texts),), search.draws.seed)
        (found,) = variants([search.spec], (), search.settings, drawn)
        return found

    def _law(self, axis: DrawAxis) -> Any:
        made = self._optuna.distributions
        match axis.law:
            case Bounds(law="integer", low=low, high=high):
                return made.IntDistribution(int(low), int(high))
            case Bounds(law=law, low=low, high=high):
                return made.FloatDistribution(low, high, log=law == "log")
            case listed:
                return made.CategoricalDistribution(listed.values)

    def _opened(self) -> Any:
        """Opens or creates the study for these distributions, model and data; their hash is in its
        name, so that other studies are not changed. Raises SpecError if the storage cannot be used.
        """
        search = self.search
        given = [(axis.path, str(axis.law)) for axis in self._axes]
        better = "maximize" if search.is_higher_better else "minimize"
        decides = (given, search.wanted, *search.decided_by)
        # in the name: values of another model or data would mislead the sampler
        digest = hashlib.sha256(repr(decides).encode()).hexdigest()[:16]
        storage = search.storage
        # it would be lost at the end, though `--optuna` promises that the study goes on
        if _IN_MEMORY.fullmatch(storage.strip()):
            raise SpecError((study_in_memory(storage),))
        try:
            if "://" not in storage:
                Path(storage).parent.mkdir(parents=True, exist_ok=True)
                # three slashes: a path relative to the working folder; an absolute one brings its
                # own fourth
                storage = f"sqlite:///{storage}"
            return self._optuna.create_study(
                storage=storage,
                study_name=f"{search.spec.name} {digest}",
                direction=better,
                load_if_exists=True,
            )
        except Exception as error:  # each database has errors of its own
            raise SpecError((unusable_study(search.storage, _reason(error)),)) from error


def _reason(error: Exception) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0]


def _text(axis: DrawAxis, value: object) -> str:
    """A proposed value as text for labels and for the spec, rounded as in a sweep
    without Optuna.
    """
    if isinstance(axis.law, Bounds) and isinstance(value, int | float):
        return axis.law.text(value)
    return str(value)


def _score(lines: Sequence[RunLine], wanted: str | None) -> float:
    """The mean of the criterion over the trainings in `lines` (seeds and folds of a variant); NaN
    if one was not completed. Raises SpecError if `wanted` was not measured.
    """
    if any(line.state != "finished" for line in lines):
        return math.nan
    criterion = chosen_criterion(lines, wanted)
    if criterion.way is None:
        return float(np.mean([line.monitor for line in lines]))
    return float(np.mean([criterion.of(line.held_out) for line in lines]))
