"""Pictures of simulations, validations and runs: what stands where, and what is left out."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pytest
from cycler import cycler
from matplotlib.colors import to_hex

import msnn
from msnn.features.data_check import figure as data_figure
from msnn.features.report_page.charts import function_charts
from msnn.reports import plotting
from msnn.reports.drawn import shown_first
from msnn.reports.learned_functions import Curve, LearnedFunction
from msnn.reports.run_plots import functions_of_run, plot_run
from msnn.reports.run_summary import read_run
from msnn.reports.simulation_plots import plot_simulation, plot_validation
from msnn.simulation.simulate import simulation_program


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Takes figures in place of files."""
    figures: list[Any] = []

    def keep(figure: Any, path: Path) -> Path:
        figures.append(figure)
        return path

    monkeypatch.setattr(plotting, "saved_figure", keep)
    return figures


def test_a_simulation_shows_measured_simulated_error_inputs_and_correlation(
    trained_run: Path, drawn: list[Any], tmp_path: Path
):
    model = msnn.load(trained_run)
    runs = msnn.simulate(model, weights=trained_run)
    plot_simulation(tmp_path / "a.png", simulation_program(model.program), runs)
    (figure,) = drawn
    axes = [axis for axis in figure.axes if axis.get_title(loc="left")]
    assert [axis.get_title(loc="left").rpartition(", ")[2] for axis in axes] == [
        "test",
        "test",
        "val",
    ]
    assert len(figure.axes) == 3 * 4
    output, error, force, correlation = figure.axes[::3]
    labels = [line.get_label() for line in output.lines]
    assert labels[:2] == ["measured", "simulated"]
    measured, simulated = (np.asarray(line.get_ydata())[:-1] for line in output.lines[:2])
    np.testing.assert_array_equal(simulated, shown_first(runs)[0].outputs["x_next"][:-1])
    # Ljung's fit is of what was measured, not of the simulation
    far, spread = np.linalg.norm(simulated - measured), np.linalg.norm(measured - measured.mean())
    fit, rmse = 100 * (1 - far / spread), far / np.sqrt(len(measured))
    assert output.texts[0].get_text() == f"fit {fit:.4g} %, rmse {rmse:.4g} m"
    # what the last step predicts was not measured
    assert np.isfinite(error.lines[0].get_ydata()[:-1]).all()
    assert force.get_ylabel() == "F / N"
    assert {line.get_label() for line in force.lines} >= {"limit"}
    assert "band: 99 % of noise" in correlation.get_xlabel()
    assert figure.get_supxlabel() == f"not drawn: {len(runs) - 3} runs"


def test_values_between_gaps_are_dots(trained_run: Path, drawn: list[Any], tmp_path: Path):
    """What a laboratory measures every twentieth sample: a line shows nothing of it."""
    model = msnn.load(trained_run)
    (run, *_) = msnn.simulate(model, weights=trained_run)
    sparse = np.array(run.logged["x_next"])
    known = np.arange(len(sparse)) % 20 == 3
    known[:3] = True  # neighbours are a line
    sparse[~known] = np.nan
    run = replace(run, logged={**run.logged, "x_next": sparse})
    plot_simulation(tmp_path / "a.png", simulation_program(model.program), [run])
    (figure,) = drawn
    output, error, *_ = figure.axes
    for axis in (output, error):
        (dots,) = [line for line in axis.lines if line.get_marker() == "o"]
        assert len(dots.get_xdata()) == np.sum(known) - 4


def test_an_interval_that_is_drawn_is_in_the_legend(
    trained_run: Path, drawn: list[Any], tmp_path: Path
):
    model = msnn.load(trained_run)
    runs = msnn.simulate(model, weights=trained_run)[:1]
    (run,) = runs
    program = simulation_program(model.program)
    entries: list[list[str]] = []
    for bands in ({}, {name: np.ones_like(values) for name, values in run.outputs.items()}):
        plot_simulation(tmp_path / "a.png", program, [replace(run, bands=bands)])
        legend = drawn[-1].axes[0].get_legend()
        entries.append([text.get_text() for text in legend.get_texts()])
    without, with_bands = entries
    assert "prediction interval" not in without
    assert with_bands == [*without, "prediction interval"]


def test_a_legend_hides_no_figures(drawn: list[Any], tmp_path: Path):
    """With limits and intervals it is nearly as wide as one of three axes."""
    model = msnn.load(
        "msnn: 1\nname: plant\nsample_time: 1 s\n"
        "inputs: {u: {unit: m}, x: {unit: m, range: [-1, 1]}}\n"
        "outputs: {y: {expr: u + 0 * x, predicts: 'x[t+1]'}}\n"
    )
    wave = np.sin(np.arange(100.0))
    runs = [
        replace(run, bands={"y": np.full_like(run.outputs["y"], 0.1)})
        for run in msnn.simulate(model, [{"u": 0.999 * wave, "x": wave}] * 3)
    ]
    plot_simulation(tmp_path / "a.png", simulation_program(model.program), runs)
    (figure,) = drawn
    figure.canvas.draw()
    for axis in figure.axes[:3]:
        legend, said = axis.get_legend(), axis.texts[0].get_window_extent()
        entries = [text.get_text() for text in legend.get_texts()]
        assert entries == ["measured", "simulated", "prediction interval", "limit"]
        assert not said.overlaps(legend.get_window_extent())
        assert not said.overlaps(axis._left_title.get_window_extent())


def test_runs_beside_each_other_show_the_same_limits(
    trained_run: Path, drawn: list[Any], tmp_path: Path
):
    model = msnn.load(trained_run)
    runs = msnn.simulate(model, weights=trained_run)[:2]
    # one run comes near the upper end of -10 … 10, one near the lower, and alone not to the other
    for run, shift in zip(runs, (6.0, -6.0), strict=True):
        run.inputs["F"][:] = 0.1 * run.inputs["F"] + shift
    plot_simulation(tmp_path / "a.png", simulation_program(model.program), runs)
    forces = [axis for axis in drawn[0].axes if axis.get_ylabel() == "F / N"]
    ends = [
        [float(line.get_ydata()[0]) for line in axis.lines if line.get_label() == "limit"]
        for axis in forces
    ]
    assert ends == [[-10.0, 10.0]] * 2


def test_limits_far_from_the_values_are_told(drawn: list[Any], tmp_path: Path):
    spec = tmp_path / "plant.msnn.yaml"
    spec.write_text(
        "msnn: 1\nname: plant\nsample_time: 1 s\n"
        "inputs: {u: {unit: V, range: [-1, 400]}, w: {range: [-5, 5]}}\n"
        "outputs: {y: u * (1 + w)}\n",
        encoding="utf-8",
    )
    model = msnn.load(spec)
    rising = np.linspace(-1, 1, 50)
    runs = msnn.simulate(model, [{"u": rising, "w": rising * far} for far in (5, 1)])
    plot_simulation(tmp_path / "a.png", simulation_program(model.program), runs)
    (figure,) = drawn
    _, *inputs = figure.axes[::2]
    ends = [
        [float(line.get_ydata()[0]) for line in axis.lines if line.get_label() == "limit"]
        for axis in inputs
    ]
    assert ends == [[-1.0], [-5.0, 5.0]]
    assert figure.get_supxlabel() == "not drawn: far limits of u: 400 V"


def test_files_that_join_are_drawn_after_each_other(drawn: list[Any], tmp_path: Path):
    """Each file counts its time from 0: the line went back at each of them."""
    for name, first in (("a", 0), ("b", 40)):
        rows = "".join(
            f"2026-11-22 17:{k // 60:02}:{k % 60:02},{k % 7}\n" for k in range(first, first + 40)
        )
        (tmp_path / f"{name}.csv").write_text("time,u\n" + rows)
    spec = tmp_path / "plant.msnn.yaml"
    spec.write_text(
        "msnn: 1\nname: plant\nsample_time: 1 s\ninputs: {u: {}}\noutputs: {y: 2 * u}\n"
        'data: {source: {train: "*.csv"}, time: time, join: true}\n',
        encoding="utf-8",
    )
    (run,) = runs = msnn.simulate(msnn.load(spec))
    assert run.places.time is not None
    plot_simulation(tmp_path / "a.png", simulation_program(msnn.load(spec).program), runs)
    (figure,) = drawn
    along = np.asarray(figure.axes[0].lines[0].get_xdata())
    assert along.tolist() == list(range(80))
    assert run.places.along(timed=False).tolist() == list(range(80))


def test_what_is_not_drawn_stays_inside_the_picture(drawn: list[Any], tmp_path: Path):
    """A line of it that was longer was cut off at the right."""
    names = [f"pressure_{letter}" for letter in "abcd"]
    spec = tmp_path / "plant.msnn.yaml"
    spec.write_text(
        "msnn: 1\nname: plant\nsample_time: 1 s\ninputs:\n"
        + "".join(f"  {name}: {{unit: bar, range: [-400, 400]}}\n" for name in names)
        + f"outputs: {{y: {' + '.join(names)}}}\n",
        encoding="utf-8",
    )
    model = msnn.load(spec)
    runs = msnn.simulate(model, {name: np.linspace(-1, 1, 50) for name in names})
    plot_simulation(tmp_path / "a.png", simulation_program(model.program), runs)
    (figure,) = drawn
    assert "pressure_d: -400 bar and 400 bar" in " ".join(figure.get_supxlabel().split())
    figure.canvas.draw()
    (said,) = [text for text in figure.texts if text.get_text().startswith("not drawn")]
    assert said.get_window_extent().x1 <= figure.bbox.x1


@pytest.mark.parametrize("untimed", [(), (1,), (0, 1)])
def test_runs_are_drawn_over_rows_unless_all_have_times(
    untimed: tuple[int, ...], trained_run: Path, drawn: list[Any], tmp_path: Path
):
    model = msnn.load(trained_run)
    runs = list(shown_first(msnn.simulate(model, weights=trained_run))[:2])
    for index in untimed:
        runs[index] = replace(runs[index], places=replace(runs[index].places, time=None))
    plot_simulation(tmp_path / "a.png", simulation_program(model.program), runs)
    (figure,) = drawn
    said = {axis.get_xlabel() for axis in figure.axes} - {""}
    assert ("row of the file" in said, "time / s" in said) == (bool(untimed), not untimed)
    for axis, run in zip(figure.axes[:2], runs, strict=True):
        along = run.places.rows if untimed else run.places.time
        np.testing.assert_array_equal(axis.lines[1].get_xdata(), along)


def test_a_validation_says_fit_and_draws_limits(
    trained_run: Path, drawn: list[Any], tmp_path: Path
):
    report = msnn.validate(msnn.load(trained_run), trained_run)
    plot_validation(tmp_path / "a.png", report)
    titles = [axis.get_title(loc="left") for axis in drawn[0].axes]
    assert all("fit " in title and "rmse " in title for title in titles if title)
    assert titles[0].endswith("rmse ≤ 0.003 kept")
    growth = drawn[0].axes[5]
    assert [float(line.get_ydata()[0]) for line in growth.lines if line.get_label() == "limit"] == [
        0.01
    ]


def test_a_look_at_data_has_the_colours_of_the_other_pictures(
    trained_run: Path, drawn: list[Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(data_figure, "saved_figure", plotting.saved_figure)
    check = msnn.check_data(msnn.load(trained_run))
    usual = "#123456"
    with matplotlib.rc_context({"axes.prop_cycle": cycler(color=[usual])}):
        data_figure.plot_data_check(tmp_path / "a.png", check)
    lines = [line for axis in drawn[0].axes for line in axis.lines]
    assert lines
    assert usual not in {to_hex(line.get_color()) for line in lines}


def test_no_picture_names_a_colour_of_matplotlib_by_its_number():
    sources = (Path(msnn.__file__).parent).rglob("*.py")
    assert not [file for file in sources if re.search(r"color=\"C\d", file.read_text("utf-8"))]


SPEC = """
msnn: 1
name: learner
sample_time: 0.1 s
inputs: {u: {unit: V, range: [-1, 1]}, w: {unit: V}}
targets: {y: {unit: m}}
parameters: {a: {init: 2, unit: m}, wide: {init: 0.5, unit: V}}
layers:
  taps: {fir: {window: 4}}
  map:
    interpolation: {x: [-1, 0, 1], x2: [-1, 1], y: [[0, 1], [2, 3], [4, 5]], unit: m, learn: true}
  sets: {fuzzify: {centers: [-1, 0, 1]}}
equations:
  bend: a * tanh(u / wide)
  part: sum(sets(u))
outputs: {y_now: {expr: "bend + map(u, w) + a * taps(u / wide) * (1 + 0 * part)", predicts: "y[t]"}}
data: {source: {train: log.csv}, split: {by: fraction, train: 0.7, val: 0.3}}
train: [{epochs: 1, batch: 10}]
"""


@pytest.fixture(scope="module")
def learner(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run whose model has a function of each kind."""
    folder = tmp_path_factory.mktemp("learner")
    (folder / "learner.msnn.yaml").write_text(SPEC, encoding="utf-8")
    random = np.random.default_rng(0)
    rows = random.uniform(-1, 1, (200, 3))
    rows[0], rows[1] = -1, 1
    np.savetxt(folder / "log.csv", rows, delimiter=",", header="u,w,y", comments="")
    result = msnn.train(msnn.load(folder / "learner.msnn.yaml"), runs=folder / "runs")
    assert result.folder is not None
    return result.folder


def test_learned_functions_are_those_of_the_trained_model(learner: Path):
    found = {each.title.partition("(")[0]: each for each in functions_of_run(read_run(learner))}
    assert set(found) == {"taps.weight: 4 taps", "map", "sets", "bend"}
    weights = read_weights(learner)
    bend = found["bend"]
    expected = weights["a"] * np.tanh(bend.x / weights["wide"])
    np.testing.assert_allclose(bend.curves[0].y, expected, rtol=1e-9)
    assert (bend.x_label, bend.y_label) == ("u / V", "bend / m")
    table = found["map"]
    assert [curve.label for curve in table.curves][::4] == ["w = -1 V", "w = 1 V"]
    for curve, column in ((table.curves[0], 0), (table.curves[-1], 1)):
        expected = np.interp(table.x, [-1, 0, 1], weights["map.y"][:, column])
        np.testing.assert_allclose(curve.y, expected, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(sum(curve.y for curve in found["sets"].curves), 1.0)
    np.testing.assert_array_equal(found["taps.weight: 4 taps"].x, [-3, -2, -1, 0])


def read_weights(run: Path) -> dict[str, Any]:
    from msnn.model.weights.weights_file import read_weights as read

    return dict(read(run / "weights.safetensors", msnn.load(run).program))


def test_a_run_shows_losses_and_functions(learner: Path, drawn: list[Any], tmp_path: Path):
    run = read_run(learner)
    functions = functions_of_run(run)
    plot_run(tmp_path / "a.svg", [stage.epochs for stage in run.stages], functions)
    titles = [axis.get_title(loc="left") for axis in drawn[0].axes]
    assert titles == ["stage_1", *(function.title for function in functions)]


def test_learned_functions_and_curves_without_room_are_told(drawn: list[Any], tmp_path: Path):
    x = np.arange(3.0)
    curves = tuple(Curve(label=f"{i}", y=x) for i in range(8))
    each = [
        LearnedFunction(
            title=f"f{i}", x=x, x_label="x", y_label="y", curves=curves[: 1 + 7 * (i == 0)]
        )
        for i in range(20)
    ]
    first = replace(each[0], left_out=4)
    plot_run(tmp_path / "a.png", [], [first, *each[1:]])
    (figure,) = drawn
    titles = [axis.get_title(loc="left") for axis in figure.axes]
    assert titles[:2] == ["f0 (5 curves not drawn)", "f1"]
    assert len(titles) == 16
    assert figure.get_supxlabel() == "not drawn: f16, f17, f18, f19"
    (shown, _), *_ = function_charts([first])
    assert shown == "f0 (4 curves not drawn)"
