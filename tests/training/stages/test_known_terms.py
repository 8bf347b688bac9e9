"""Priors and penalties with corners: known minima, in every engine, with every optimiser."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache

import numpy as np
import pytest

from backends.known_terms import approached, known_terms
from compiler.ir.program import Loss, Measure, Parameter, Penalty, Program
from compiler.ir.types import Axis
from msnn.data.dataset import FloatArray
from msnn.data.rollout_rows import Runs
from msnn.simulation.rollout import LossSum
from msnn.training.plans.loss_terms import residuals_of
from msnn.training.plans.stage_data import stage_data
from msnn.training.plans.stage_plan import plan_stages
from msnn.training.records.learned.standard_errors import standard_errors
from msnn.training.train import TrainingOptions, TrainingResult, train
from spec_schema.diagnostics.diagnostic import Findings, SpecError
from spec_schema.sections.training import Stage
from tests.conditions import require_tool
from tests.training.cases import compiled, dataset

IN_MEMORY = TrainingOptions(runs=None)
RANDOM = np.random.default_rng(11)
ROWS = 40
U = RANDOM.uniform(-1, 1, (ROWS, 4)) @ np.diag([1.0, 3.0, 0.3, 1.0])
Y = U @ [1.5, -0.2, 0.8, 0.0] + RANDOM.normal(0, 0.3, ROWS)

OPTIMISERS = {
    "lm native": "optimizer: levenberg_marquardt, engine: native, epochs: 60",
    "lm torch": "optimizer: levenberg_marquardt, engine: torch, epochs: 60",
    "adam native": "optimizer: {adam: {lr: 0.05}}, engine: native",
    "adam torch": "optimizer: {adam: {lr: 0.05}}, engine: torch",
    "sgd native": "optimizer: {sgd: {lr: 0.02, momentum: 0.8}}, engine: native",
    "sgd torch": "optimizer: {sgd: {lr: 0.02, momentum: 0.8}}, engine: torch",
    "lbfgs": "optimizer: lbfgs, epochs: 30",
}
LONG = "epochs: 500, dtype: float64, schedule: {cosine: {to: 0.001}}, batch: 40"


@pytest.fixture(params=OPTIMISERS)
def stage(request: pytest.FixtureRequest) -> str:
    require_tool("gcc", install="apt install gcc")
    chosen = OPTIMISERS[request.param]
    return chosen if "epochs" in chosen else f"{chosen}, {LONG}"


@pytest.fixture(params=[name for name in OPTIMISERS if name != "lbfgs"])
def to_corners(request: pytest.FixtureRequest) -> str:
    require_tool("gcc", install="apt install gcc")
    chosen = OPTIMISERS[request.param]
    return chosen if "epochs" in chosen else f"{chosen}, {LONG}"


def run(parameters: str, stage: str, more: str = "", y: FloatArray = Y) -> TrainingResult:
    program, spec = compiled(text_of(parameters, stage, more))
    return train(program, dataset({"u": U, "y": y}, train=[ROWS]), spec.train, IN_MEMORY)


def text_of(parameters: str, stage: str, more: str = "") -> str:
    return (
        "msnn: 1\nname: line\ndims: {column: 4}\n"
        "inputs: {u: {unit: s, dims: column}}\ntargets: {y: m}\n"
        f"parameters: {{w: {{dims: column, unit: mm/s, {parameters}}}}}\n"
        'outputs: {z: {expr: sum(w * u), predicts: "y[t]"}}\n'
        f"{more}train: [{{{stage}}}]\n"
    ).replace("targets: {y: m}", "targets: {y: mm}")


def posterior_mode(mean: float, std: float) -> FloatArray:
    """The fixed point of ŝ² = rᵀr/n and (UᵀU + ŝ²/std²) w = Uᵀy + ŝ² mean/std²."""
    w = np.asarray(np.linalg.lstsq(U, Y, rcond=None)[0], dtype=np.float64)
    for _ in range(200):
        ratio = float(np.mean((U @ w - Y) ** 2)) / std**2
        known = U.T @ U + ratio * np.eye(4)
        w = np.asarray(np.linalg.solve(known, U.T @ Y + ratio * mean), dtype=np.float64)
    return w


def test_the_posterior_mode_is_that_of_the_closed_form(stage: str) -> None:
    """The prior is written in other units than the parameter."""
    result = run("init: 0, scale: 2, prior: {mean: 0.0005 m/s, std: 0.2 mm/s}", stage)
    # what is left of the steps of a first-order optimiser at the end of its schedule
    assert result.weights["w"] == pytest.approx(posterior_mode(0.5, 0.2), abs=2e-4)


def test_a_prior_without_width_pins_the_parameter(stage: str) -> None:
    result = run("init: 0, prior: {mean: 0.5, std: 1e-9}", stage)
    assert result.weights["w"] == pytest.approx(np.full(4, 0.5), abs=1e-7)


def test_a_wide_prior_changes_nothing(stage: str) -> None:
    short = stage.replace(LONG, LONG.replace("500", "50"))  # none of both has to arrive
    wide = run("init: 0, prior: {mean: 0.5, std: 1e9}", short).weights["w"]
    assert wide == pytest.approx(run("init: 0", short).weights["w"], abs=1e-9)


def test_a_prior_of_a_bounded_parameter(stage: str) -> None:
    """The most probable values of physical numbers, whatever variable stands behind them."""
    result = run("init: 1, min: -5, scale: 2, prior: {mean: 0.5, std: 0.2}", stage)
    assert result.weights["w"] == pytest.approx(posterior_mode(0.5, 0.2), abs=1e-3)


@pytest.mark.parametrize(
    ("measure", "skip", "scored", "rows", "square"),
    [("mse", 0, 180, 40, 9.0), ("rmse", 0, 180, 40, 1.5), ("mae", 2, 108, 38, 4.5)],
)
def test_a_prior_counts_beside_rows_by_what_their_loss_is_to_a_likelihood(
    measure: str, skip: int, scored: int, rows: int, square: float
) -> None:
    """Of 40 rows there are 36 rollouts of 5, which score most rows five times.

    -2 ln of the likelihood of n residuals is n ln mse of Gauss, so 2 n ln rmse, and 2 n ln mae of
    Laplace: where 2 n ln F + d stands still, so does F + F d / (2 n).
    """
    stage = f"optimizer: adam, rollout: {{horizon: 5, stride: 1, skip: {skip}}}"
    loss = f'losses: {{fit: "{measure}(z, y)"}}\n'
    program, spec = compiled(text_of("init: 0, prior: {mean: 0.5, std: 0.2}", stage, loss))
    (plan,) = plan_stages(program, spec.train, Findings())
    runs = Runs(np.arange(36), np.full(36, 5), skipped=0, longest=ROWS)
    found = residuals_of(plan, {"fit": LossSum(9.0 * scored, scored)}, runs)
    assert found.square == pytest.approx(square)
    assert found.spread == pytest.approx(square / rows)


def descended(slope: Callable[[FloatArray], FloatArray], start: FloatArray) -> FloatArray:
    """Where plain gradient descent in numpy ends."""
    found = start
    for _ in range(20_000):
        found = found - 0.02 * slope(found)
    return found


DECAY = 0.3


def ridge_slope(w: FloatArray) -> FloatArray:
    """The gradient of mse + λ/2 Σ w²."""
    return 2 / ROWS * U.T @ (U @ w - Y) + DECAY * w


def bounded_slope(raw: FloatArray) -> FloatArray:
    """The gradient of mse + λ/2 Σ raw² of w = -5 + 10 sigmoid(raw)."""
    share = 1 / (1 + np.exp(-raw))
    residuals = U @ (10 * share - 5) - Y
    return 2 / ROWS * (U.T @ residuals) * 10 * share * (1 - share) + DECAY * raw


@pytest.mark.parametrize("bounds", ["", ", min: -5, max: 5"], ids=["free", "bounded"])
def test_the_kept_epoch_is_that_of_the_decayed_total(stage: str, bounds: str) -> None:
    """From the least squares on every step of the decay makes the losses larger."""
    start = np.asarray(np.linalg.lstsq(U, Y, rcond=None)[0], dtype=np.float64)
    if bounds:
        logit = np.asarray(np.log((5 + start) / (5 - start)), dtype=np.float64)
        raw = descended(bounded_slope, logit)
        wanted = 10 / (1 + np.exp(-raw)) - 5
    else:
        wanted = descended(ridge_slope, start)
    assert np.abs(wanted - start).max() > 0.1
    found = run(f"init: {start.tolist()}{bounds}", f"{stage}, weight_decay: {DECAY}").weights["w"]
    assert found == pytest.approx(wanted, abs=1e-3)


@pytest.mark.parametrize("optimizer", ["adamw", "{torch: AdamW}"])
def test_decoupled_decay_is_no_part_of_what_chooses_an_epoch(optimizer: str) -> None:
    """No total of losses and weights is smallest where its steps end: the losses alone choose."""
    start = np.linalg.lstsq(U, Y, rcond=None)[0]
    stage = f"optimizer: {optimizer}, epochs: 5, dtype: float64, batch: {ROWS}, weight_decay: 0.3"
    assert run(f"init: {start.tolist()}", stage).weights["w"] == pytest.approx(start, abs=1e-12)


@pytest.mark.parametrize("optimizer", ["adam", "sgd", "lbfgs", "levenberg_marquardt"])
def test_validation_chooses_by_its_losses_alone(optimizer: str) -> None:
    """Weights that fit what nobody trained on are best there, however large they are."""
    require_tool("gcc", install="apt install gcc")
    start = np.linalg.lstsq(U, Y, rcond=None)[0]
    program, spec = compiled(
        text_of(f"init: {start.tolist()}", f"optimizer: {optimizer}, epochs: 5, weight_decay: 30")
    )
    data = dataset({"u": U, "y": Y}, train=[30], val=[10])
    watched = slice(30, 40)
    found = train(program, data, spec.train, IN_MEMORY)
    ended = float(np.mean((U[watched] @ found.weights["w"] - Y[watched]) ** 2))
    assert found.stages[0].best_value == pytest.approx(ended, rel=1e-5)


@pytest.mark.parametrize("engine", ["torch", "native"])
def test_what_is_best_counts_the_prior(engine: str) -> None:
    """From the least squares on every step towards the prior makes the residuals larger."""
    if engine == "native":
        require_tool("gcc", install="apt install gcc")
    start = np.linalg.lstsq(U, Y, rcond=None)[0].tolist()
    stage = f"optimizer: levenberg_marquardt, epochs: 60, engine: {engine}"
    found = run(f"init: {start}, prior: {{mean: 0.5, std: 0.2}}", stage).weights["w"]
    assert found == pytest.approx(posterior_mode(0.5, 0.2), abs=1e-5)


@pytest.mark.parametrize("optimiser", ["lm native", "lm torch", "adam native", "lbfgs"])
@pytest.mark.parametrize(("horizon", "skip", "std"), [(5, 0, 0.2), (8, 5, 0.2), (8, 5, None)])
def test_of_overlapping_rollouts_the_best_is_what_they_minimise(
    optimiser: str, horizon: int, skip: int, std: float | None
) -> None:
    """Each row counts as often as it is scored, beside the prior all rows once."""
    require_tool("gcc", install="apt install gcc")
    chosen = OPTIMISERS[optimiser]
    stage = chosen if "epochs" in chosen else f"{chosen}, {LONG}"
    prior = "" if std is None else f", prior: {{mean: 0.5, std: {std}}}"
    program, spec = compiled(
        "msnn: 1\nname: line\ninputs: {u: 1}\ntargets: {y: 1}\n"
        f"parameters: {{w: {{init: 0{prior}}}}}\n"
        'outputs: {z: {expr: w * u, predicts: "y[t]"}}\n'
        f"train: [{{{stage}, rollout: {{horizon: {horizon}, stride: 1, skip: {skip}}}}}]\n"
    )
    random = np.random.default_rng(0)
    u = random.uniform(-1, 1, ROWS)
    y = 1.5 * u + random.normal(0, 0.3, ROWS)
    result = train(program, dataset({"u": u, "y": y}, train=[ROWS]), spec.train, IN_MEMORY)
    times = np.zeros(ROWS)
    for begin in range(ROWS - horizon + 1):
        times[begin + skip : begin + horizon] += 1
    w, share = 0.0, times / times.sum()
    for _ in range(500):
        ratio = 0.0
        if std is not None:
            ratio = float(share @ (w * u - y) ** 2) / np.count_nonzero(times) / std**2
        w = (float(share @ (u * y)) + 0.5 * ratio) / (float(share @ u**2) + ratio)
    assert float(result.weights["w"]) == pytest.approx(w, abs=1e-4)


@pytest.mark.parametrize(
    ("batch", "prior", "val", "watched"),
    [
        (7, "", 0, [0, 8, 16, 24]),
        (23, "", 0, range(23)),
        (7, ", prior: {mean: 0.5, std: 0.2}", 0, range(23)),
        (7, ", prior: {mean: 0.5, std: 0.2}", 20, [30, 38, 46]),
    ],
)
def test_all_overlapping_rollouts_are_watched_where_steps_lower_their_total(
    batch: int, prior: str, val: int, watched: Sequence[int]
) -> None:
    """Decision 0480; 30 rows have 23 starts of 8 steps, and validation minimises nothing."""
    program, spec = compiled(
        "msnn: 1\nname: line\ninputs: {u: 1}\ntargets: {y: 1}\n"
        f"parameters: {{w: {{init: 0{prior}}}}}\n"
        'outputs: {z: {expr: w * u, predicts: "y[t]"}}\n'
        f"train: [{{batch: {batch}, rollout: {{horizon: 8, stride: 1}}}}]\n"
    )
    data = dataset(
        {"u": np.ones(50), "y": np.ones(50)}, train=[30], **({"val": [val]} if val else {})
    )
    (plan,) = plan_stages(program, spec.train, Findings())
    found = stage_data(plan, data, Findings())
    assert found is not None
    assert len(found.train) == 23
    assert found.watched.t0.tolist() == list(watched)


@cache
def lasso(weight: float, grouped: int) -> FloatArray:
    """min mse + weight · Σ of norms of slices of `grouped` numbers, by plain proximal gradient."""
    w = np.zeros(4)
    rate = 1 / np.linalg.eigvalsh(2 * U.T @ U / ROWS).max()
    for _ in range(20_000):
        w = w - rate * 2 * U.T @ (U @ w - Y) / ROWS
        parts = w.reshape(-1, grouped)
        norms = np.linalg.norm(parts, axis=1, keepdims=True)
        shrunk = np.maximum(1 - rate * weight / np.maximum(norms, 1e-300), 0)
        w = (parts * shrunk).ravel()
    return w


CORNERS = {
    "l1": ("l1(w)", 0.2, 1, 0.8),
    "group of numbers": ("group(w, over=column)", 0.2, 1, 0.2),
}


@pytest.mark.parametrize("penalty", CORNERS)
def test_numbers_become_exactly_0_where_the_lasso_has_them(to_corners: str, penalty: str) -> None:
    expression, weight, size, factor = CORNERS[penalty]
    losses = f'losses: {{fit: "mse(z, y)", few: {{expr: "{expression}", weight: {factor}}}}}\n'
    found = run("init: 0.3, scale: 2", to_corners, losses).weights["w"]
    wanted = lasso(weight, size)
    assert 0 < np.count_nonzero(wanted) < 4
    assert list(found == 0.0) == list(wanted == 0.0)
    assert found == pytest.approx(wanted, abs=2e-4)


MATRIX = """
msnn: 1
name: pairs
dims: {side: 2, pair: 2}
inputs: {u: {dims: [pair, side]}}
targets: {y: 1}
parameters: {W: {dims: [side, pair], init: 0.3, scale: 1.5}}
outputs: {z: {expr: "sum(W * u)", predicts: "y[t]"}}
losses: {fit: "mse(z, y)", few: {expr: "group(W, over=pair)", weight: 0.25}}
"""


SLICED = U[:, [2, 3, 0, 1]]
"""What the slices of W are multiplied by, one after the other."""


@cache
def lasso_of_slices() -> FloatArray:
    """The same for the slices of W, whose norms count 0.25."""
    w, rate = np.zeros(4), 1 / np.linalg.eigvalsh(2 * U.T @ U / ROWS).max()
    for _ in range(20_000):
        parts = (w - rate * 2 * SLICED.T @ (SLICED @ w - Y) / ROWS).reshape(2, 2)
        norms = np.linalg.norm(parts, axis=1, keepdims=True)
        w = (parts * np.maximum(1 - rate * 0.25 / norms, 0)).ravel()
    return w


def test_slices_become_exactly_0(to_corners: str) -> None:
    program, spec = compiled(f"{MATRIX}train: [{{{to_corners}}}]\n")
    data = dataset({"u": SLICED.reshape(-1, 2, 2), "y": Y}, train=[ROWS])
    found = train(program, data, spec.train, IN_MEMORY).weights["W"].T
    w = lasso_of_slices()
    assert not w[:2].any()
    assert w[2:].all()
    assert not found[0].any()
    assert found[1] == pytest.approx(w[2:], abs=2e-4)


@pytest.mark.parametrize("optimiser", ["adam", "adamw", "{sgd: {momentum: 0.9}}"])
@pytest.mark.parametrize(
    ("parameters", "penalty"),
    [
        ("init: 0.1, prior: {mean: 0.5, std: 0.2}", "l2(w)"),
        ("init: 0.1, max: 4, prior: {mean: 0.5, std: 0.2}", "l1(w)"),
        ("init: 0.1, scale: 3", "l1(w)"),
        ("init: 0.1, scale: 0.3", "group(w, over=column)"),
        ("init: 0.1, prior: {mean: 0.5, std: 0.2}", "l1(w) + 0.3 * group(w, over=column)"),
    ],
)
def test_both_engines_take_the_same_steps(optimiser: str, parameters: str, penalty: str) -> None:
    require_tool("gcc", install="apt install gcc")
    losses = f'losses: {{fit: "mse(z, y)", few: {{expr: "{penalty}", weight: 0.3}}}}\n'
    stage = f"optimizer: {optimiser}, epochs: 25, batch: 16, dtype: float64, engine: "
    native, torch = (run(parameters, stage + one, losses) for one in ("native", "torch"))
    # float64 in the same order of batches: what differs is how sums are rounded
    np.testing.assert_allclose(native.weights["w"], torch.weights["w"], rtol=1e-9, atol=1e-12)
    assert native.stages[0].best_value == pytest.approx(torch.stages[0].best_value, rel=1e-9)


def test_a_proximal_step_is_the_least_of_its_definition() -> None:
    """Against a search in all directions around it, in a metric with unequal lengths."""
    array = Parameter("w", (Axis("row", 2), Axis("column", 2)), None, (0.0,) * 4, scale=0.7)
    losses = [
        Loss("l", Measure.MEAN, 0, None, penalty=Penalty("w", None)),
        Loss("g", Measure.MEAN, 0, None, penalty=Penalty("w", "row")),
    ]
    terms = known_terms([array], losses, {"l": 0.4, "g": 0.5}, {"w"})
    start, steps = np.array([0.9, -0.4, 0.05, 0.02]), np.array([0.3, 1.1, 0.5, 0.2])

    def cost(raw: FloatArray) -> float:
        w = 0.7 * raw.reshape(2, 2)
        norms = np.sqrt((w**2).sum(axis=1)).sum()
        near = ((raw - start) ** 2 / (2 * steps)).sum()
        return float(near + 0.4 * np.abs(w).mean() + 0.5 * norms)

    found = approached(terms, start, steps, 0.0)
    assert not found[2:].any()
    assert found[:2].all()
    least = cost(found)
    random = np.random.default_rng(4)
    for size in (1e-2, 1e-4, 1e-6):
        for _ in range(200):
            assert cost(found + size * random.normal(size=4)) >= least - 1e-15


def test_standard_errors_include_the_prior() -> None:
    require_tool("gcc", install="apt install gcc")
    text = text_of("init: 0, prior: {mean: 0.5, std: 0.2}", "optimizer: levenberg_marquardt")
    program, spec = compiled(text)
    data = dataset({"u": U, "y": Y}, train=[ROWS])
    result = train(program, data, spec.train, IN_MEMORY)
    (plan,) = plan_stages(program, spec.train, Findings())
    found = standard_errors(plan, data, result.weights)
    residual = U @ result.weights["w"] - Y
    square = float(residual @ residual)
    precision = U.T @ U + square / ROWS / 0.2**2 * np.eye(4)
    freedom = ROWS - np.trace(np.linalg.solve(precision, U.T @ U))
    noise = square / freedom
    half = np.linalg.solve(precision, np.eye(4))
    spread = half @ (noise * U.T @ U + (square / ROWS / 0.2) ** 2 * np.eye(4)) @ half
    assert found.errors["w"] == pytest.approx(np.sqrt(np.diagonal(spread)), rel=1e-6)
    alone = standard_errors(plan_stages(*_without_prior(), Findings())[0], data, result.weights)
    assert (found.errors["w"] < alone.errors["w"]).all()


def _without_prior() -> tuple[Program, Sequence[Stage]]:
    program, spec = compiled(text_of("init: 0", "optimizer: levenberg_marquardt"))
    return program, spec.train


@pytest.mark.parametrize(
    ("parameters", "losses", "code"),
    [
        ("init: 0, prior: {mean: 0, std: 1}", '{few: "l2(w)"}', "E0966"),
        ("init: 0, min: -1", '{few: "group(w, over=column)"}', "E0967"),
        ("init: 0", '{few: "group(2 * w, over=column)"}', "E0967"),
        ("init: 0", '{a: "group(w, over=column)", b: "group(w, over=column)"}', "E0968"),
        ("init: 0", '{a: "group(w)"}', "E0352"),
        ("init: 0", '{a: "group(w, over=side)"}', "E0406"),
    ],
)
def test_what_cannot_be_known_is_said(parameters: str, losses: str, code: str) -> None:
    with pytest.raises(SpecError) as caught:
        run(parameters, "epochs: 1", f"losses: {losses}\n")
    assert [d.code for d in caught.value.diagnostics if d.severity == "error"] == [code]


def test_an_optimiser_that_follows_slopes_says_so() -> None:
    losses = 'losses: {few: "l1(w)", fit: "mse(z, y)"}\n'
    text = text_of("init: 1", "optimizer: lbfgs", losses)
    program, spec = compiled(text)
    findings = Findings()
    plan_stages(program, spec.train, findings)
    assert [d.code for d in findings.in_order] == ["W0911"]
