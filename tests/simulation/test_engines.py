"""Engines of `validate` and `simulate`: they agree, the choice among them, doubts about limits."""

from __future__ import annotations

from collections.abc import Generator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from backends.native import rollout_kernel
from backends.native.rollout_kernel import RolloutSource
from compiler.ir.program import Program
from msnn.api import measurements
from msnn.data.dataset import FloatArray
from msnn.data.rollout_rows import Runs
from msnn.model.load import load_model
from msnn.simulation.engines import open_rollouts as opening
from msnn.simulation.engines.kernel_check import WrongKernelError
from msnn.simulation.engines.native_rollouts import NativeRollouts
from msnn.validation.validate import ValidationReport, validate
from spec_schema.diagnostics.diagnostic import SpecError
from tests.conditions import require_tool
from tests.examples.gallery import NAMES, gallery_copy, spec_of
from tests.training.cases import dataset, gain, gain_series

HALF = {"a": np.array(0.5), "b": np.array(0.3)}
FREE_RUN = 1e-9
"""Of the largest value: what engines may differ in, where the dynamics contract."""


@pytest.fixture(autouse=True)
def _compiler() -> None:
    require_tool("gcc", install="apt install gcc")


@pytest.fixture(scope="module")
def gallery(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return gallery_copy(tmp_path_factory.mktemp("gallery"))


@pytest.mark.parametrize("engine", ["native", "torch"])
@pytest.mark.parametrize("name", NAMES)
def test_the_gallery_is_simulated_alike(name: str, engine: str, gallery: Path) -> None:
    model = load_model(spec_of(gallery, name))
    found = measurements.simulate(model, horizon=50, engine=engine)
    right = measurements.simulate(model, horizon=50, engine="interpreter")
    assert len(found) == len(right)
    for ours, judged in zip(found, right, strict=True):
        for output, values in judged.outputs.items():
            tolerance = FREE_RUN * float(np.nanmax(np.abs(values)))
            np.testing.assert_allclose(
                ours.outputs[output], values, rtol=FREE_RUN, atol=tolerance, equal_nan=True
            )


CHECKS = """
  - {of: x_next}
  - {of: x_next, metric: fit}
  - {of: x_next, rollout: {horizon: 7, skip: 2}}
  - {of: x_next, rollout: {horizon: 9, stride: 4}, metric: aic}
  - {of: x_next, rollout: record, data: test}
  - {of: x_next, rollout: episode, metric: max_abs}
  - {of: fit, rollout: record, data: val}
  - {of: fit, rollout: 5}
  - {of: heavy, rollout: {horizon: 8, warm_up: 3}}
  - {of: x_next, rollout: {horizon: record, warm_up: 5}, skip_rows: 30}
"""


@pytest.mark.parametrize("engine", ["native", "torch"])
def test_every_way_to_simulate_is_measured_alike(engine: str) -> None:
    """Horizons, strides that overlap, skips, sets within records, metrics and losses.

    A missing sample is a missing target, and where a step reads it there is no prediction.
    """
    found, right = validated(CHECKS, engine=engine), validated(CHECKS, engine="interpreter")
    for ours, judged in zip(found.rows, right.rows, strict=True):
        assert ours.value == pytest.approx(judged.value, rel=1e-8, nan_ok=True)
        assert (ours.rows, ours.scored) == (judged.rows, judged.scored)
    assert sum(np.isfinite(row.value) for row in right.rows) >= 4
    for ours, judged in zip(found.measurements, right.measurements, strict=True):
        assert (ours.horizon, ours.rows, ours.scored) == (
            judged.horizon,
            judged.rows,
            judged.scored,
        )
        if judged.curve is not None:
            assert ours.curve is not None
            np.testing.assert_allclose(ours.curve.rmse, judged.curve.rmse, rtol=1e-8)


def gapped() -> dict[str, FloatArray]:
    series = gain_series(400)
    series["x"][[205, 330]] = np.nan
    return series


LOSSES = """
losses:
  fit: mse(x_next, x[t+1])
  heavy: {expr: "mae(x_next, x[t+1])", rows: abs(u)}
"""


def validated(checks: str, **how: object) -> ValidationReport:
    program, spec = gain(more=f"{LOSSES}validate:{checks}")
    data = dataset(gapped(), test=[200, 150], val=[50])
    return validate(program, data, spec.checks, HALF, **how)  # pyright: ignore[reportArgumentType]


def test_little_work_is_done_by_the_interpreter(monkeypatch: pytest.MonkeyPatch) -> None:
    with counted_kernels(monkeypatch) as made:
        validated("\n  - {of: x_next, rollout: record}\n")
        assert made == []
        monkeypatch.setattr(opening, "kernel_seconds", lambda _: 0.0)
        validated("\n  - {of: x_next, rollout: record}\n")
        assert len(made) == 1


def test_entries_of_one_rollout_are_one_simulation(monkeypatch: pytest.MonkeyPatch) -> None:
    steps: list[tuple[int, int]] = []
    with counted_kernels(monkeypatch) as made:
        validated(
            "\n  - {of: x_next, rollout: record}\n  - {of: x_next, rollout: record, metric: fit}\n",
            engine="native",
            progress=lambda done, total: steps.append((done, total)),
        )
    assert len(made) == 1
    assert steps[-1][0] == steps[-1][1]


def test_without_a_compiler_the_interpreter_runs_and_says_so(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("CC", "no-such-compiler")
    monkeypatch.setattr(opening, "kernel_seconds", lambda _: 0.0)
    check = "\n  - {of: x_next, rollout: record}\n"
    found = validated(check)
    assert [warning.code for warning in found.warnings if warning.code != "W0805"] == ["W1003"]
    assert found.rows[0].value == validated(check, engine="interpreter").rows[0].value
    with pytest.raises(SpecError, match="E1042"):
        validated(check, engine="native")


@pytest.mark.usefixtures("goes_on_without_kernels")
def test_a_wrong_kernel_is_not_used(monkeypatch: pytest.MonkeyPatch) -> None:
    right = rollout_kernel.rollout_source

    def wrong(program: Program) -> RolloutSource:
        made = right(program)
        text = made.source.text.replace("to[i] = kept[i][l];", "to[i] = kept[i][l] * 1.000001;")
        assert text != made.source.text
        return replace(made, source=replace(made.source, text=text))

    monkeypatch.setattr(rollout_kernel, "rollout_source", wrong)
    monkeypatch.setattr(opening, "kernel_seconds", lambda _: 0.0)
    check = "\n  - {of: x_next, rollout: record}\n"
    found = validated(check)
    (warning,) = [warning for warning in found.warnings if warning.code == "W1003"]
    assert WrongKernelError.__name__ in warning.message
    assert found.rows[0].value == validated(check, engine="interpreter").rows[0].value


def test_an_engine_that_there_is_not(gallery: Path) -> None:
    model = load_model(spec_of(gallery, "motor"))
    for verb in (measurements.validate, measurements.simulate):
        with pytest.raises(SpecError, match="E1043"):
            verb(model, engine="natve")


@pytest.mark.parametrize("of", ["x_next, metric: rmse", "fit"])
def test_a_limit_between_two_engines_is_judged_by_the_interpreter(
    of: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An engine that is off by less than engines may be decides nothing."""
    right = validated(f"\n  - {{of: {of}, rollout: record}}\n", engine="interpreter").rows[0].value
    limited = f"\n  - {{of: {of}, rollout: record, max: {right!r}}}\n"
    with slightly_off(monkeypatch):
        unlimited = validated(f"\n  - {{of: {of}, rollout: record}}\n", engine="native")
        found = validated(limited, engine="native")
        far = validated(limited.replace(repr(right), repr(right * 0.999)), engine="native")
    assert unlimited.rows[0].value > right
    assert found.rows[0].value == right
    assert found.passed
    assert far.rows[0].value == unlimited.rows[0].value
    assert not far.passed


@contextmanager
def slightly_off(monkeypatch: pytest.MonkeyPatch) -> Generator[None]:
    """Kernels whose errors are all larger by half of what engines may differ in."""
    outputs, losses = NativeRollouts.outputs, NativeRollouts.losses

    def more(self: NativeRollouts, runs: Runs, advance: object) -> Mapping[str, FloatArray]:
        found = outputs(self, runs, advance)  # pyright: ignore[reportArgumentType]
        return {name: values - 0.5e-9 * np.abs(values).max() for name, values in found.items()}

    def more_losses(self: NativeRollouts, *arguments: object) -> object:
        found = losses(self, *arguments)  # pyright: ignore[reportArgumentType]
        return {name: replace(sum, total=sum.total * (1 + 1e-9)) for name, sum in found.items()}

    with monkeypatch.context() as patched:
        patched.setattr(NativeRollouts, "outputs", more)
        patched.setattr(NativeRollouts, "losses", more_losses)
        yield


@contextmanager
def counted_kernels(monkeypatch: pytest.MonkeyPatch) -> Generator[list[Program]]:
    """The programs that kernels are made of."""
    made: list[Program] = []
    right = rollout_kernel.rollout_source

    def source(program: Program) -> RolloutSource:
        made.append(program)
        return right(program)

    monkeypatch.setattr(rollout_kernel, "rollout_source", source)
    yield made
