"""What a training says of its course: losses, kept epochs, parameters, fed-back signals."""

from __future__ import annotations

import numpy as np
import pytest

from msnn.data.dataset import Dataset, FloatArray
from msnn.training.records.progress import Silent, StageStart, stage_text
from msnn.training.train import TrainingOptions, train
from spec_schema.diagnostics.diagnostic import Diagnostic
from tests.training.cases import compiled, dataset, gain, gain_series


class Heard(Silent):
    """Keeps what a run says."""

    def __init__(self) -> None:
        self.said: list[Diagnostic] = []
        self.lines: list[str] = []

    def stage_started(self, event: StageStart) -> None:
        self.lines.append(stage_text(event))

    def warned(self, diagnostic: Diagnostic) -> None:
        self.said.append(diagnostic)


def heard(text: str, data: Dataset) -> Heard:
    program, spec = compiled(text)
    found = Heard()
    train(program, data, spec.train, TrainingOptions(runs=None), found)
    return found


def notes(text: str, data: Dataset) -> list[Diagnostic]:
    codes = ("W0936", "W0937", "W0938")
    return [each for each in heard(text, data).said if each.code in codes]


SUM = """
msnn: 1
name: sum
inputs: {u: 1}
targets: {p: 1, q: 1}
parameters: {k: 1, b: 0}
outputs: {ph: {expr: 1000 * k * u}, qh: {expr: k * u + b}}
losses: {p: "mse(ph, p)", q: {expr: "mse(qh, q)", weight: WEIGHT}}
train: [{name: fit, engine: torch, optimizer: levenberg_marquardt}]
"""


def pair(seed: int = 0) -> Dataset:
    random = np.random.default_rng(seed)
    u = random.uniform(1, 2, 100)
    p = 2000 * u + 300 * random.normal(size=100)
    return dataset({"u": u, "p": p, "q": 2 * u + 1 + 0.3 * random.normal(size=100)}, train=[100])


def test_a_loss_that_decides_alone_is_named_with_those_that_hardly_count() -> None:
    (found,) = notes(SUM.replace("WEIGHT", "1"), pair())
    assert found.message.startswith("`p` is 99.99 % of the total of stage `fit`: `q` hardly counts")
    assert notes(SUM.replace("WEIGHT", "1e6"), pair()) == []


def test_weights_by_variance_are_not_advised_where_they_are_in_force() -> None:
    """A signal of noise alone stays at its variance, whatever the weights are."""
    random = np.random.default_rng(3)
    u = random.uniform(-3, 3, 200)
    p = 1e5 + 250 * u + 1000 * random.normal(size=200)
    data = dataset({"u": u, "p": p, "q": 2 * u + 0.01 * random.normal(size=200)}, train=[200])
    text = """
msnn: 1
name: unlike
inputs: {u: 1}
targets: {p: {unit: Pa}, q: {unit: m}}
parameters: {a: {init: 100, unit: Pa}, b: {init: 1.7, unit: m}}
constants: {p0: 1e5 Pa}
outputs: {ph: {expr: p0 + a*u, predicts: "p[t]"}, qh: {expr: b*u, predicts: "q[t]"}}
LOSSES
train: [{name: fit, engine: torch, optimizer: levenberg_marquardt}]
"""
    assert notes(text.replace("LOSSES", ""), data) == []
    written = 'losses: {p: "mse(ph, p)", q: "mse(qh, q)"}'
    (found,) = notes(text.replace("LOSSES", written), data)
    assert found.code == "W0936"


def test_a_penalty_beside_one_loss_decides_nothing() -> None:
    text = SUM.replace('q: {expr: "mse(qh, q)", weight: WEIGHT}', "small: l2(k)")
    assert notes(text, pair()) == []


SLOW = """
msnn: 1
name: slow
inputs: {u: 1}
targets: {y: 1}
parameters: {near: 1, far: {init: INIT, scale: SCALE}}
outputs: {z: {expr: near * u + FACTOR * far, predicts: "y[t]"}}
train: [{name: fit, engine: torch, epochs: 30, batch: 20, optimizer: {adam: {lr: 0.02}}, MORE}]
"""


def slow(init: str, scale: str, factor: str, more: str = "seed: 1") -> list[Diagnostic]:
    text = SLOW.replace("INIT", init).replace("SCALE", scale).replace("FACTOR", factor)
    u = np.linspace(-1, 1, 100)
    return notes(text.replace("MORE", more), dataset({"u": u, "y": 2 * u + 0.6}, train=[100]))


def test_a_parameter_that_hardly_moved_is_named() -> None:
    """150 steps of 0.02 move a number of 5000 by less than a thousandth."""
    (found,) = slow("5000", "1", "1e-4")
    assert found.message == "`far` moved by less than 1 % of its scale"
    # a scale of its size, and steps of it
    assert slow("5000", "5000", "1e-4") == []
    # small beside a scale of 1, which nobody wrote, and yet far from where it was
    assert slow("1e-4", "1", "12000", "lr: {far: 1e-3}") == []


@pytest.mark.parametrize("loss", ["mse(z, y)", "rmse(z, y)", "huber(z, y, delta=0.5)"])
@pytest.mark.parametrize(("level", "named"), [(295.0, False), (294.0, False), (310.0, True)])
def test_a_level_that_went_its_way_is_none_that_hardly_moved(
    loss: str, level: float, named: bool
) -> None:
    """1 K is a third of a percent of 294 K, and all that was missing; of 16 K 2 are not."""
    text = SLOW.replace("lr: 0.02", "lr: 0.013")
    text = text.replace("near: 1", "near: {init: 1, unit: K}").replace('predicts: "y[t]"', "")
    text = text.replace("{init: INIT, scale: SCALE}", "{init: 294, unit: K}").replace(", }", "}")
    text = text.replace("targets: {y: 1}", "targets: {y: {unit: K}}").replace("FACTOR * ", "")
    text = text.replace("train:", f"losses: {{fit: '{loss}'}}\ntrain:").replace("MORE", "seed: 1")
    u = np.linspace(-1, 1, 100)
    y = 2 * u + level + 0.1 * np.random.default_rng(6).normal(size=100)
    found = notes(text, dataset({"u": u, "y": y}, train=[100]))
    assert [each.message.partition(" moved")[0] for each in found] == ["`far`"] * named


def test_what_is_held_or_solved_for_is_no_parameter_that_hardly_moved() -> None:
    assert slow("5000", "1", "1e-4", "lr: {far: 0}") == []
    assert slow("5000", "1", "1e-4", "freeze: [far]") == []
    text = SLOW.replace("INIT", "0.6").replace("SCALE", "1").replace("FACTOR", "1")
    text = text.replace("{adam: {lr: 0.02}}", "levenberg_marquardt").replace("batch: 20, ", "")
    u = np.linspace(-1, 1, 100)
    data = dataset({"u": u, "y": 2 * u + 0.6}, train=[100])
    assert notes(text.replace("MORE", "seed: 1"), data) == []


def test_a_parameter_that_an_earlier_stage_moved_is_none_either() -> None:
    text = SLOW.replace("INIT", "3").replace("SCALE", "1").replace("FACTOR", "0.1")
    more = "seed: 1}, {name: fine, engine: torch, epochs: 1, optimizer: {adam: {lr: 1e-6}}"
    u = np.linspace(-1, 1, 100)
    data = dataset({"u": u, "y": 2 * u + 0.6}, train=[100])
    assert notes(text.replace("MORE", more), data) == []


DECAY = """
msnn: 1
name: decay
sample_time: 1 s
inputs: {u: 1}
targets: {y: 1}
parameters: {a: {init: 0.2}, b: {init: 0.1}}
states: {x: {next: a * x + b * u, init: y}}
outputs: {z: {expr: x, predicts: y}}
train: [{name: fit, engine: torch, rollout: {horizon: 50, stride: 50}, OPTIMIZER, epochs: 40}]
"""


def decay(rows: int, truth: float, seed: int) -> dict[str, FloatArray]:
    random = np.random.default_rng(seed)
    u = random.choice([-1.0, 1.0], rows)
    x = np.zeros(rows)
    for t in range(rows - 1):
        x[t + 1] = truth * x[t] + 0.5 * u[t]
    return {"u": u, "y": x}


def unlike(truth: float) -> Dataset:
    """Validation rows of another system than those of training."""
    parts = decay(1000, 0.9, 1), decay(100, truth, 2)
    joined = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    return dataset(joined, train=[1000], val=[100])


def test_a_least_squares_stage_that_keeps_an_epoch_of_its_way_says_how_few_rollouts_decide() -> (
    None
):
    text = DECAY.replace("OPTIMIZER", "optimizer: levenberg_marquardt")
    (found,) = notes(text, unlike(0.6))
    assert found.code == "W0938"
    assert "the best over 2 rollouts of `val`: the loss of training fell from " in found.message
    assert "`rollout.horizon`" in (found.help or "")
    assert "`split:`" in (found.help or "")
    # of the same system the last epoch is the best of both
    assert notes(text, unlike(0.9)) == []


def test_the_loss_of_training_after_the_epoch_that_is_kept_is_that_of_its_weights() -> None:
    """One step finds a gain; the total of that epoch is of the weights before the step."""
    random = np.random.default_rng(4)
    u = random.uniform(-3, 3, 200)
    # a gain of validation just below that of training, on the way there from 1.9
    y = np.where(np.arange(200) < 180, 2.0, 1.99) * u + 0.01 * random.normal(size=200)
    text = """
msnn: 1
name: gain
inputs: {u: 1}
targets: {y: 1}
parameters: {b: 1.9}
outputs: {z: {expr: b * u, predicts: "y[t]"}}
train: [{name: fit, engine: torch, optimizer: levenberg_marquardt}]
"""
    data = dataset({"u": u, "y": y}, train=[180], val=[20])
    program, spec = compiled(text)
    (stage,) = train(program, data, spec.train, TrainingOptions(runs=None)).stages
    assert stage.best_epoch == 1 < stage.epochs
    assert notes(text, data) == []


def test_a_monitor_far_above_the_loss_of_training_is_told() -> None:
    text = DECAY.replace("OPTIMIZER", "optimizer: {adam: {lr: 0.05}}")
    text = text.replace("epochs: 40", "epochs: 150")
    noisy = unlike(0.9)
    noisy.series["y"][1000:] += 0.5 * np.random.default_rng(5).normal(size=100)
    (found,) = [each for each in notes(text, noisy) if each.code == "W0938"]
    assert found.message.startswith("stage `fit`: the loss over 2 rollouts of `val` is 0.")
    assert found.message.endswith(" in epoch 150, the last")
    assert [each for each in notes(text, unlike(0.9)) if each.code == "W0938"] == []


@pytest.mark.parametrize(
    ("rollout", "predicts", "named"),
    [
        ("10", "x[t+1]", True),
        ("record", "x[t+1]", True),
        ("{horizon: 10, close: []}", "x[t+1]", False),
        ("1", "x[t+1]", False),
        ("1", "x[t]", True),
    ],
)
def test_the_line_of_a_stage_names_what_is_fed_back(
    rollout: str, predicts: str, named: bool
) -> None:
    """An adaptive model that predicts its own input learns nothing from its own predictions."""
    text = f"  - {{name: fit, engine: torch, epochs: 1, rollout: {rollout}}}\n"
    program, spec = gain(text)
    if predicts == "x[t]":
        from tests.training.cases import GAIN

        program, spec = compiled(
            GAIN.replace("a*x + b*u", "a*x[t-1] + b*u").replace("x[t+1]", "x[t]")
            + f"train:\n{text}"
        )
    found = Heard()
    data = dataset(gain_series(60), train=[60])
    train(program, data, spec.train, TrainingOptions(runs=None), found)
    (line,) = found.lines
    assert ("predictions fed back into x" in line) == named


@pytest.mark.parametrize("optimizer", ["levenberg_marquardt", "{adam: {lr: 0.05}}"])
def test_a_stage_that_keeps_what_it_began_with_says_how_few_rollouts_decide(
    optimizer: str,
) -> None:
    """The initial values are those of the validation rows; every step leads away from them."""
    text = DECAY.replace("OPTIMIZER", f"optimizer: {optimizer}").replace("0.2}", "0.6}")
    text = text.replace("{init: 0.1}", "{init: 0.5}").replace("epochs: 40", "epochs: 150")
    data = unlike(0.6)
    data.series["y"][1000:] += 0.5 * np.random.default_rng(5).normal(size=100)
    said = heard(text, data).said
    (kept,) = [each for each in said if each.code == "W0938"]
    (learned,) = [each for each in said if each.code == "W0912"]
    advice = learned.help or ""
    if optimizer == "levenberg_marquardt":
        assert kept.message.startswith("stage `fit` keeps epoch 0 of ")
        # it has no rate that could be smaller
        assert advice.startswith("try other initial values;")
    else:
        assert " in epoch 0, the best; over those of training it is " in kept.message
        assert advice.startswith("try a smaller learning rate;")
