"""Free runs over whole records: the numbers of a plain loop, and a file that can be read back."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from compiler.passes.close_loop import close_loop
from msnn.data.reading.load import load_data
from msnn.simulation.simulate import simulate, simulation_program, write_simulation
from tests.data.specs import data_section
from tests.programs import joint_arm
from tests.training.cases import dataset, gain, gain_series

WEIGHTS = {"a": np.array(0.5), "b": np.array(0.3)}


def test_a_free_run_starts_at_the_first_possible_row_and_ends_with_the_record() -> None:
    program, _ = gain()
    data = dataset(gain_series(50), test=[30, 20])
    first, second = simulate(simulation_program(program), data, WEIGHTS)
    assert (first.first, second.record.file) == (0, "test1.csv")
    x, u = data.series["x"], data.series["u"]
    state, expected = x[30], []
    for t in range(30, 50):
        state = 0.5 * state + 0.3 * u[t]
        expected.append(state)
    np.testing.assert_allclose(second.outputs["x_next"], expected, rtol=1e-14)
    # the last step predicts a row that the record does not have, and never that of the next one
    for run, measured in ((first, x[1:30]), (second, x[31:50])):
        np.testing.assert_array_equal(run.logged["x_next"], [*measured, np.nan])


def test_open_inputs_are_read_from_the_record() -> None:
    program, _ = gain()
    data = dataset(gain_series(30), test=[30])
    (run,) = simulate(simulation_program(program, close=()), data, WEIGHTS)
    x, u = data.series["x"], data.series["u"]
    np.testing.assert_allclose(run.outputs["x_next"], 0.5 * x + 0.3 * u, rtol=1e-14)


def test_a_simulation_asks_for_no_column_that_it_does_not_read(tmp_path: Path) -> None:
    from tests.programs import spring_damper_rk4

    program = spring_damper_rk4().program
    (tmp_path / "a.csv").write_text("F,x\n1,0.1\n2,0.2\n")
    section = data_section("source: {any: a.csv}\n")
    free = simulation_program(program)
    assert [signal.name for signal in free.signals] == ["F", "x.meas"]  # x.meas starts the state
    assert len(simulate(free, load_data(free, section, tmp_path))) == 1


def test_the_file_has_one_row_a_step(tmp_path: Path) -> None:
    sample = joint_arm()
    data = dataset(sample.log(20, 1), test=[20])
    program = simulation_program(sample.program)
    runs = simulate(program, data)
    path = write_simulation(tmp_path / "out.csv", program, runs)
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 17  # the arm reads three samples back
    assert (rows[0]["file"], rows[0]["row"]) == ("test0.csv", "3")
    assert float(rows[0]["time"]) == 3 * 0.001
    assert [float(row["q_next[elbow]"]) for row in rows] == runs[0].outputs["q_next"][:, 1].tolist()
    assert float(rows[0]["q_next[base].log"]) == data.series["q"][4, 0]
    assert rows[-1]["q_next[base].log"] == ""


def test_what_is_closed_is_what_the_engine_closes() -> None:
    sample = joint_arm()
    closed = close_loop(sample.program, sample.closed)
    assert simulation_program(sample.program).states == closed.states
