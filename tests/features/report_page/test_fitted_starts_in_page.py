"""The running model of a page begins where the record shown does, and held inputs are steps."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import msnn
from tests.conditions import require_package, require_tool
from tests.features.report_page.browser import opened, wait

OVEN = """
msnn: 1
name: oven
sample_time: 1 s
dims: {part: 2}
inputs: {P: {unit: W, between: hold}, A: {unit: K, between: linear}}
targets: {T: {unit: K}}
parameters: {a: {init: 0.02, min: 0}, b: 0.03, r: {dims: part, init: [0.9, 0.8], learn: false}}
states:
  Tc: {unit: K, next: "Tc + a*(A - Tc) + b*P", init: {fit: {over: 20}}}
  h: {dims: part, unit: K, next: "r*h", init: {fit: {over: 20}}}
outputs: {T_hat: {expr: "Tc + sum(h)", predicts: "T[t]", unit: K}}
data: {source: {train: "oven*.csv"}}
train: [{rollout: record, epochs: 20, optimizer: {levenberg_marquardt: {}}}]
"""
STARTS = (294.0, 310.0)


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory):
    """The page of a trained model of an oven, with records from two temperatures."""
    require_tool("gcc", install="apt install gcc")
    require_package("ziglang", "make setup")
    folder: Path = tmp_path_factory.mktemp("oven")
    (folder / "oven.msnn.yaml").write_text(OVEN.lstrip())
    random = np.random.default_rng(1)
    for number, start in enumerate(STARTS):
        rows: list[tuple[float, float, float]] = []
        x, h = start, np.array([8.0, -4.0])
        for t in range(200):
            power, air = 100.0 * ((t // 40) % 3), 290.0 + 5.0 * np.sin(0.05 * t)
            rows.append((power, air, x + float(h.sum()) + 0.05 * random.normal()))
            x, h = x + 0.02 * (air - x) + 0.03 * power, np.array([0.9, 0.8]) * h
        head = "P [W],A [K],T [K]"
        np.savetxt(folder / f"oven{number}.csv", rows, "%.9g", ",", header=head, comments="")
    model = msnn.load(folder / "oven.msnn.yaml")
    run = msnn.train(model, runs=folder / "runs")
    assert run.folder is not None
    with opened(msnn.report(run.folder).path) as browser:
        wait(browser, "document.getElementById('golden').classList.contains('good')")
        yield browser


def choose(page: Any, source: str) -> None:
    page.execute_script(
        "const c = document.getElementById('live-source'); c.value = arguments[0];"
        "c.dispatchEvent(new Event('change'));",
        source,
    )


@pytest.mark.parametrize("record", [0, 1])
def test_the_running_model_begins_where_the_record_does(page: Any, record: int) -> None:
    """It climbed from 0 K beside a recording at 294 K, "uninitialised"."""
    choose(page, str(record))
    page.execute_script("bench.steps(200)")
    first = page.execute_script("return bench.series.outputs[0][0]")
    # the measurement, within its noise
    assert first[0] == pytest.approx(STARTS[record] + 4, abs=0.5)
    # what the page draws of the simulation, which begins there too
    drawn = page.execute_script(
        f"return [...numbers(DATA.records[{record}].outputs[0].simulated)].slice(0, 200)"
    )
    assert first == pytest.approx(drawn, abs=1e-3)
    assert page.execute_script("return bench.bits") == 0


def test_a_start_is_chosen_by_sliders(page: Any) -> None:
    choose(page, "")
    knobs = page.find_elements("css selector", "[id^='live-start-']")
    assert [knob.get_attribute("id") for knob in knobs] == [
        "live-start-Tc-0",
        "live-start-h-0",
        "live-start-h-1",
    ]
    assert all(knob.is_enabled() for knob in knobs)
    for knob, value in zip(knobs, (300, 1, 2), strict=True):
        page.execute_script(
            "arguments[0].min = 0; arguments[0].max = 400; arguments[0].value = arguments[1];"
            "arguments[0].dispatchEvent(new Event('input'));"
            "arguments[0].dispatchEvent(new Event('change'));",
            knob,
            value,
        )
    page.execute_script("bench.steps(1)")
    assert page.execute_script("return bench.series.outputs[0][0][0]") == pytest.approx(303.0)
    choose(page, "0")
    assert not any(knob.is_enabled() for knob in knobs)
    # a record moves what is shown, and not what was chosen
    choose(page, "")
    page.execute_script("bench.steps(1)")
    assert page.execute_script("return bench.series.outputs[0][0][0]") == pytest.approx(303.0)


def test_held_inputs_are_drawn_as_steps_and_linear_ones_as_lines(page: Any) -> None:
    choose(page, "0")
    page.execute_script("bench.steps(60); bench.show()")
    corners = page.execute_script("""
        const found = {};
        for (const chart of charts) for (const panel of chart.spec.panels)
            for (const series of panel.series) {
                const name = series.label || series.name, drawn = [];
                if (name !== 'P' && name !== 'A') continue;
                const g = {beginPath() {}, stroke() {}, setLineDash() {}, moveTo() {}, arc() {},
                           lineTo: (x, y) => drawn.push([x, y])};
                paint_line(g, [1, 3], 0, 2, {x: (v) => v}, (v) => v, (i) => i, false, series.held);
                (found[name] ||= []).push(drawn);
            }
        return found;
    """)
    # of the chart of records and of the running model
    assert corners["P"] == [[[1, 1], [1, 3]]] * 2
    assert corners["A"] == [[[1, 3]]] * 2
