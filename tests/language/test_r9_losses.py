"""R9: the losses of a spec; what they compare, and what is there without `losses:`."""

from compiler.program import Measure, Prediction
from tests.language.compiled import codes, compiled

HEAD = """
inputs: {x: m, u: N}
targets: {z: m}
layers: {h: {fir: {window: 3}}}
outputs:
  x_next: {expr: h(x) + u, predicts: "x[t+1]"}
  zhat: {expr: 2 * x, predicts: z}
  other: x + 1
"""


def test_r9_each_prediction_has_the_default_loss() -> None:
    program = compiled(HEAD)
    assert [(loss.name, loss.measure, loss.weight) for loss in program.losses] == [
        ("x_next", Measure.MSE, 1.0),
        ("zhat", Measure.MSE, 1.0),
    ]
    assert program.output("zhat").predicts == Prediction("z", 0)


def test_r9_with_losses_only_the_listed_ones_count() -> None:
    text = HEAD + 'losses: {only: {expr: "rmse(zhat, z)", weight: 0.1}, size: l2(h(x))}\n'
    losses = compiled(text).losses
    assert [(loss.name, loss.measure, loss.weight) for loss in losses] == [
        ("only", Measure.RMSE, 0.1),
        ("size", Measure.MEAN, 1.0),
    ]


def test_r9_bare_inputs_of_a_loss_are_their_log() -> None:
    """`x` in the loss is the log even when `x` is closed; inside an equation it is what runs."""
    program = compiled(HEAD + 'losses: {a: "mse(x_next, x[t+1])", b: "mse(other, x)"}')
    nodes = program.step
    target = program.losses[1].target
    assert target is not None
    assert type(nodes[target].op).__name__ == "ReadLog"
    assert "ReadSignal" in {type(node.op).__name__ for _, node in nodes}


def test_r9_a_loss_function_is_no_value() -> None:
    assert codes(HEAD + 'losses: {a: "2 * mse(x_next, x[t+1])"}') == ["E0310"]
    assert codes(HEAD + 'losses: {a: "mse(x_next)"}') == ["E0305"]
    assert codes(HEAD.replace("other: x + 1", "other: mse(x, u)")) == ["E0310"]
