"""Ranks, the Pareto front, information criteria and the rule of one standard error."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from msnn.features.comparison.ranking import (
    Criterion,
    Ranked,
    cheapest_as_good,
    chosen_criterion,
    common_ways,
    ranked,
)
from msnn.features.comparison.variants import Variant
from msnn.training.records.run_log import Cost, Measured, RunLine
from spec_schema.diagnostics.diagnostic import SpecError
from tests.features.comparison.test_run_log import LINE

ERROR = Criterion(("y", "one step", "m"), "rmse")
FIT = Criterion(("y", "one step", "m"), "fit")


def measured(**metrics: float) -> tuple[Measured, ...]:
    asked = next(iter(metrics))
    return (
        Measured(of="y", unit="m", rollout="one step", scored=100, asked=asked, metrics=metrics),
    )


def line(score: float, instructions: float, metric: str = "rmse") -> RunLine:
    found = measured(**{metric: score})
    return replace(LINE, held_out=found, training=found, cost=Cost("core", instructions, 1, 1))


def models(*each: Sequence[RunLine]) -> dict[Variant, Sequence[RunLine]]:
    return {Variant(Path("s"), (), str(number)): lines for number, lines in enumerate(each)}


def labels(entries: Sequence[Ranked]) -> list[str]:
    return [entry.variant.label for entry in entries]


def test_the_smallest_error_and_the_largest_fit_are_best():
    found = ranked(models([line(3, 1)], [line(1, 1)], [line(2, 1)]), ERROR)
    assert (labels(found), found[0].is_best) == (["1", "2", "0"], True)
    found = ranked(models([line(3, 1, "fit")], [line(1, 1, "fit")]), FIT)
    assert labels(found) == ["0", "1"]


def test_models_without_a_score_come_last_and_are_never_best():
    broken = replace(line(math.nan, 1), state="diverged")
    found = ranked(models([broken], [line(math.nan, 1)], [line(2, 1)]), ERROR)
    assert labels(found)[0] == "2"
    assert [entry.is_best for entry in found] == [True, False, False]
    assert [entry.is_on_front for entry in found] == [True, False, False]
    only = ranked(models([broken]), ERROR)
    assert not only[0].is_best


def test_a_model_that_failed_on_some_folds_is_not_best_by_the_others():
    broken = replace(line(math.nan, 1), state="diverged")
    found = ranked(models([line(1, 1), broken], [line(2, 1), line(2, 1)]), ERROR)
    assert labels(found) == ["1", "0"]
    assert [entry.is_best for entry in found] == [True, False]
    assert [entry.is_on_front for entry in found] == [True, False]
    assert cheapest_as_good(found, ERROR) is None
    # where all failed somewhere, what there is says most
    found = ranked(models([line(2, 1), broken], [line(1, 1), broken]), ERROR)
    assert labels(found) == ["1", "0"]
    assert found[0].is_best


@given(st.lists(st.tuples(st.integers(0, 5), st.integers(0, 5)), min_size=1, max_size=12))
def test_the_front_is_what_no_other_model_dominates(points: list[tuple[int, int]]):
    found = ranked(models(*([line(error, cost)] for error, cost in points)), ERROR)

    def dominated(point: tuple[float, float]) -> bool:
        return any(
            error <= point[0] and cost <= point[1] and (error, cost) != point
            for error, cost in points
        )

    front = {(entry.score, entry.expense) for entry in found if entry.is_on_front}
    assert front == {point for point in points if not dominated(point)}
    assert sum(entry.is_on_front for entry in found) == len(front), "equals stand there once"


def test_information_criteria_are_those_of_gaussian_errors():
    generator = np.random.default_rng(0)
    errors = generator.normal(0.1, 0.3, 100)
    variance = float(np.var(errors))
    likely = 100 * math.log(2 * math.pi * variance) + float(errors @ errors) / variance
    found = replace(LINE, parameters=4, training=measured(aic=likely + 8, fit=1.0))
    (entry,) = ranked(models([found]), FIT)
    aic, bic = entry.information(FIT.way)
    assert aic == pytest.approx((likely + 2 * 4) / 100)
    assert bic == pytest.approx((likely + 4 * math.log(100)) / 100)


def test_errors_that_are_all_0_are_the_best_there_is():
    perfect, mixed = [line(-math.inf, 9)] * 2, [line(-math.inf, 1), line(2, 1)]
    found = ranked(models([line(1, 1)] * 2, perfect), ERROR)
    assert labels(found) == ["1", "0"]
    assert (found[0].score, found[0].deviation) == (-math.inf, 0.0)
    assert cheapest_as_good(found, ERROR) is None
    (only,) = ranked(models(mixed), ERROR)
    assert math.isnan(only.deviation)
    assert cheapest_as_good([only], ERROR) is None


def test_a_model_costs_what_its_dearest_training_learns():
    """Folds in which a penalty leaves numbers out do not make it cheaper."""
    of_folds = ((1.0, 40), (1.1, 90), (0.9, 60))
    lines = [replace(line(error, 0), cost=None, parameters=count) for error, count in of_folds]
    (entry,) = ranked(models(lines), ERROR)
    assert entry.parameters == 90
    assert entry.expense == 90
    assert entry.score == pytest.approx(1.0)
    assert entry.deviation == pytest.approx(0.1)


def test_the_cheapest_within_a_standard_error_is_named():
    good = [line(1.0, 90), line(1.2, 90)]  # mean 1.1, standard error 0.1
    near, far = [line(1.19, 50)], [line(1.21, 10)]
    found = ranked(models(good, near, far), ERROR)
    cheaper = cheapest_as_good(found, ERROR)
    assert cheaper is not None
    assert cheaper.variant.label == "1"
    assert cheapest_as_good(ranked(models(good, far), ERROR), ERROR) is None
    assert cheapest_as_good(ranked(models([line(1, 9)], near), ERROR), ERROR) is None


def test_models_are_ranked_by_what_all_were_measured_of():
    one = measured(rmse=1.0, fit=90.0)
    other = replace(one[0], rollout="record")
    lines = [replace(LINE, held_out=(other, *one)), replace(LINE, held_out=one)]
    assert common_ways(lines) == (("y", "one step", "m"),)
    assert chosen_criterion(lines, None) == ERROR
    assert chosen_criterion(lines, "y.fit") == FIT
    assert chosen_criterion(lines[:1], "rmse:one") == ERROR
    assert chosen_criterion([replace(LINE, held_out=())], None) == Criterion(None, "monitor")
    for wanted in ("rmse:record", "z.rmse", "mae", ""):
        with pytest.raises(SpecError) as caught:
            chosen_criterion(lines, wanted)
        assert [found.code for found in caught.value.diagnostics] == ["E0976"]


def test_units_that_differ_are_not_compared():
    other = replace(measured(rmse=1.0)[0], unit="mm")
    lines = [line(1, 1), replace(LINE, held_out=(other,))]
    with pytest.raises(SpecError) as caught:
        common_ways(lines)
    (found,) = caught.value.diagnostics
    assert found.code == "E0975"
    assert found.notes == (
        f"`{lines[0].model}` measures y in m, one step",
        f"`{LINE.model}` measures y in mm, one step",
    )
