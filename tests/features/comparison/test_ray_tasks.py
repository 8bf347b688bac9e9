"""What is sent to a cluster together, and what becomes of it when it is killed."""

from __future__ import annotations

import sys
from collections.abc import Callable
from itertools import count
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import msnn as api
from msnn.features.comparison.ray_tasks import Task
from msnn.packages import OptionalPackage
from msnn.project.new_project import new_project
from msnn.training.records.run_log import LOG, read
from tests.cli.test_check import SPEC
from tests.features.comparison.pretended_ray import (
    PretendedRay,
    RayError,
    RayTaskError,
    TaskOSError,
)

ASKED: dict[str, Any] = {
    "grid": {"parameters.k.init": ["8 N/m", "9 N/m", "11 N/m"]},
    "settings": {"train.0.epochs": 2, "data.split": {"by": "kfold", "k": 3}},
    "folds": True,
}


@pytest.fixture
def cluster(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Callable[[Callable[[Task], Exception | None]], PretendedRay]:
    """Opens a cluster in a fresh project."""
    monkeypatch.chdir(new_project(tmp_path / "plant"))
    monkeypatch.setattr(OptionalPackage, "is_installed", property(lambda _: True))

    # each training takes a tenth of a second
    clock = SimpleNamespace(monotonic=count(0, 0.1).__next__)
    monkeypatch.setattr("msnn.features.comparison.ray_tasks.time", clock)

    def opened(raised: Callable[[Task], Exception | None]) -> PretendedRay:
        found = PretendedRay(raised)
        monkeypatch.setitem(sys.modules, "ray", found)
        return found

    return opened


Cluster = Callable[[Callable[[Task], Exception | None]], PretendedRay]


def numbers(tasks: list[Task]) -> list[list[tuple[str, int | None]]]:
    return [[(sent.trial.variant.label, sent.trial.fold) for sent in task.trials] for task in tasks]


def test_short_trainings_of_a_variant_are_one_task_and_each_is_there_once(cluster: Cluster):
    """The first tell how long they take; models and series are sent once each."""
    ray = cluster(lambda _: None)
    there = api.sweep(SPEC, **ASKED, ray="auto", runs="there")
    # three before the first result, as many as wait for a processor; then all folds of a variant
    assert numbers(ray.tasks) == [
        *([("init=8 N/m", fold)] for fold in (1, 2, 3)),
        [("init=9 N/m", fold) for fold in (1, 2, 3)],
        [("init=11 N/m", fold) for fold in (1, 2, 3)],
    ]
    assert len(ray.stored) == 3 + 3 + 1  # models, rows of folds, series
    here = api.sweep(SPEC, **ASKED, runs="here")
    assert there.best is not None
    assert here.best is not None
    assert there.best.score == here.best.score
    lines = {line.key: line for line in read(Path("there", LOG))}
    assert len(lines) == len(read(Path("there", LOG))) == 9
    for line in read(Path("here", LOG)):
        assert lines[line.key].held_out == line.held_out
        kept = [Path(runs, str(line.folder), "weights.safetensors") for runs in ("here", "there")]
        assert kept[0].read_bytes() == kept[1].read_bytes()


def test_who_kills_a_process_takes_no_other_training_with_it(cluster: Cluster):
    def killed(task: Task) -> Exception | None:
        kills = ("init=11 N/m", 2) in numbers([task])[0]
        return RayError("the worker died") if kills else None

    ray = cluster(killed)
    found = api.sweep(SPEC, **ASKED, ray="auto")
    assert numbers(ray.tasks)[-4:] == [
        [("init=11 N/m", fold) for fold in (1, 2, 3)],
        *([("init=11 N/m", fold)] for fold in (1, 2, 3)),
    ]
    refused = [line for entry in found.entries for line in entry.failed]
    assert sum(len(entry.lines) for entry in found.entries) == 8
    assert [(line.model, line.fold) for line in refused] == [("init=11 N/m", 2)]
    assert "E0977" in refused[0].reason


def test_seeds_leave_the_files_that_they_leave_here(cluster: Cluster):
    cluster(lambda _: None)
    for runs, ray in (("here", None), ("there", "auto")):
        api.sweep(SPEC, settings=ASKED["settings"], seeds=2, ray=ray, runs=runs)
    lines = read(Path("here", LOG))
    assert [line.seed for line in lines] == [0, 1]
    weights: set[bytes] = set()
    for line in lines:
        here, there = (Path(runs, str(line.folder)) for runs in ("here", "there"))
        left = sorted(path.relative_to(here) for path in here.rglob("*"))
        assert left == sorted(path.relative_to(there) for path in there.rglob("*"))
        file = "weights.safetensors"
        assert (here / file).read_bytes() == (there / file).read_bytes()
        weights.add((here / file).read_bytes())
    assert len(weights) == 2


def test_tasks_begin_again_where_a_node_is_killed_and_not_after_a_mistake(cluster: Cluster):
    ray = cluster(lambda _: None)
    api.sweep(SPEC, **ASKED, ray="auto")
    assert ray.options["max_retries"] == 3
    retried = tuple(ray.options["retry_exceptions"])
    assert issubclass(RayError, retried)
    assert issubclass(FileNotFoundError, retried), "of a node that is going"
    assert not issubclass(ZeroDivisionError, retried)


def test_a_node_with_another_version_is_told(cluster: Cluster, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("msnn.features.comparison.ray_tasks.__version__", "0.0.1")
    cluster(lambda _: None)
    found = api.sweep(SPEC, **ASKED, ray="auto")
    failed = [line for entry in found.entries for line in entry.failed]
    assert len(failed) == 9
    assert all("a node has msnn 0.0.1" in line.reason for line in failed)
    assert not Path("runs", LOG).exists(), "its results would stand beside those of this one"


def test_a_disk_of_a_node_that_is_full_is_told(cluster: Cluster):
    def full(task: Task) -> Exception | None:
        is_full = "init=11 N/m" in dict(numbers([task])[0])
        return TaskOSError(OSError(28, "No space left on device")) if is_full else None

    cluster(full)
    found = api.sweep(SPEC, **ASKED, ray="auto")
    lines = [line for entry in found.entries for line in entry.failed]
    assert len(lines) == 3
    for line in lines:
        assert "E0864" in line.reason
        assert "No space left on device" in line.reason


def test_a_mistake_of_a_task_is_not_taken_for_a_node_that_died(cluster: Cluster):
    cluster(lambda _: RayTaskError(ZeroDivisionError("ours")))
    with pytest.raises(RayTaskError, match="ours"):
        api.sweep(SPEC, **ASKED, ray="auto")
