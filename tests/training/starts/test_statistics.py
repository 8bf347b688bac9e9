"""R12: `normalize` by the statistics of the training data, known from the first stage on."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import msnn
from compiler.interpreter.interpreter import Interpreter
from compiler.ir.program import Program, Statistic
from compiler.program_file.file import program_from_data, program_to_data
from msnn.data.dataset import FloatArray
from msnn.model.weights.weights_file import initial_weights
from msnn.training.stage_loss_module import stage_loss
from msnn.training.train import TrainingOptions, train
from spec_schema.diagnostics.diagnostic import SpecError
from spec_schema.sections.spec import Spec
from tests.language.compiled import codes
from tests.training.cases import compiled, dataset

MODEL = """
msnn: 1
name: scaled
sample_time: 1 s
dims: {joint: 2}
inputs: {x: m, q: {unit: rad, dims: joint}}
targets: {z: N}
layers:
  nx: {normalize: {mean: data, std: data}}
  nq: {normalize: {mean: data, std: [1, 2]}}
  nz: {normalize: {mean: data, std: data, of: z, unit: N}}
  net: {linear: {}}
outputs:
  force: {expr: "nz.inverse(net(nx(x), nx(x[t-1]), nq(q)))", predicts: "z", unit: N}
train:
  - {epochs: 3, batch: 8, optimizer: {adam: {lr: 0.01}}}
  - {epochs: 2, batch: 8, optimizer: {sgd: {}}, engine: torch}
"""


def series(rows: int = 60) -> dict[str, FloatArray]:
    random = np.random.default_rng(1)
    z = random.normal(100, 7, rows)
    z[[3, 9]] = np.nan
    return {"x": random.normal(-4, 3, rows), "q": random.normal([1, 50], 2, (rows, 2)), "z": z}


def model() -> tuple[Program, Spec]:
    return compiled(MODEL)


def test_statistics_are_those_of_the_training_rows_and_never_learned() -> None:
    program, spec = model()
    data = dataset(series(), train=[20, 15], val=[25])
    result = train(program, data, spec.train, TrainingOptions(runs=None))
    rows = {name: values[:35] for name, values in data.series.items()}
    weights = result.weights
    assert weights["nx.mean"] == pytest.approx(np.mean(rows["x"]), rel=1e-14)
    assert weights["nx.std"] == pytest.approx(np.std(rows["x"]), rel=1e-14)
    assert weights["nz.std"] == pytest.approx(np.nanstd(rows["z"]), rel=1e-14)
    np.testing.assert_allclose(weights["nq.mean"], rows["q"].mean(axis=0), rtol=1e-14)
    assert "nq.std" not in weights
    assert not np.array_equal(weights["net.weight"], initial_weights(program)["net.weight"])


def test_values_are_normalised_and_come_back() -> None:
    program, _ = model()
    weights = initial_weights(program)
    weights |= {"nx.mean": np.array(2.0), "nx.std": np.array(4.0), "nq.mean": np.array([1.0, 5.0])}
    weights |= {"nz.mean": np.array(100.0), "nz.std": np.array(10.0)}
    weights |= {"net.weight": np.array([1.0, 10, 100, 1000]), "net.bias": np.array(0.5)}
    log = series()
    found = Interpreter(program, weights).step(log, [1], {}).outputs["force"]
    x, q = log["x"], log["q"][1]
    net = (x[1] - 2) / 4 + 10 * (x[0] - 2) / 4 + 100 * (q[0] - 1) + 1000 * (q[1] - 5) / 2 + 0.5
    assert found[0] == pytest.approx(100 + 10 * net, rel=1e-14)


def test_people_s_own_loops_begin_with_the_statistics() -> None:
    program, spec = model()
    data = dataset(series(), train=[35])
    loss = stage_loss(program, data, spec.train, 0, None)
    assert loss.weights()["nx.mean"] == pytest.approx(np.mean(data.series["x"]), rel=1e-6)
    given = initial_weights(program)
    assert stage_loss(program, data, spec.train, 0, given).weights()["nx.mean"] == 0


def test_given_weights_keep_their_statistics() -> None:
    program, spec = model()
    data = dataset(series(), train=[35])
    weights = initial_weights(program) | {"nx.mean": np.array(7.0)}
    result = train(program, data, spec.train, TrainingOptions(runs=None), weights=weights)
    assert result.weights["nx.mean"] == 7


def test_constant_and_missing_signals_have_none() -> None:
    program, spec = model()
    log = series()
    log["x"][:] = 0.1
    log["z"][:] = np.nan
    with pytest.raises(SpecError) as raised:
        train(program, dataset(log, train=[35]), spec.train, TrainingOptions(runs=None))
    assert [d.code for d in raised.value.diagnostics] == ["E0925"] * 3


def test_program_files_keep_where_a_value_comes_from() -> None:
    program, _ = model()
    again = program_from_data(program_to_data(program), "file")
    assert again.parameter("nz.mean").statistic == Statistic("mean", "z")
    assert again == program


def test_without_training_nothing_is_exported_or_simulated(tmp_path: Path) -> None:
    path = tmp_path / "scaled.msnn.yaml"
    path.write_text(MODEL, encoding="utf-8")
    loaded = msnn.load(path)
    with pytest.raises(SpecError, match="E0926"):
        msnn.export(loaded, "c", tmp_path / "out")
    with pytest.raises(SpecError, match="E0926"):
        msnn.simulate(loaded, series())


HEAD = (
    "inputs: {x: m, u: m}\nlayers: {n: {normalize: {mean: data, std: data%s}}}\noutputs: {y: %s}\n"
)


@pytest.mark.parametrize(
    ("of", "call", "code"),
    [
        ("", "n(x + u)", "E0313"),
        ("", "n(x) + n(u)", "E0313"),
        ("", "n.inverse(x) + u", "E0313"),
        (", of: n", "n(x) + u", "E0313"),
        (", of: w", "n(x) + u", "E0301"),
    ],
)
def test_mistake(of: str, call: str, code: str) -> None:
    assert codes(HEAD % (of, call)) == [code]


def test_of_lets_anything_be_normalised() -> None:
    assert codes(HEAD % (", of: u", "n(x + u) + n(2 * x)")) == []
