"""What `msnn show` says of a controller."""

from __future__ import annotations

from pathlib import Path

from msnn.features.control.problem.optimal_control import ControlProblem
from msnn.features.control.show import control_text
from msnn.model.load import load_model
from msnn.reports.show import interface_text
from tests.features.control.specs import DOUBLE_INTEGRATOR, load, mpc


def test_sizes_limits_and_how_it_is_solved(tmp_path: Path) -> None:
    section = mpc(
        bounds="{u: {max: most, rate: 5}, v: {min: -1, hard: true}, "
        "p: {max: 3, soft: {linear: 7}}}",
        references="{most: {}}",
        blocks="[1, 4, 10]",
        solver="{interior_point: {mode: fixed, iterations: 4}}",
    )
    model = load(tmp_path, DOUBLE_INTEGRATOR + section)
    control = model.of(ControlProblem)
    assert control is not None
    lines = control_text(control).splitlines()
    assert lines[0] == (
        "predictive controller: 1 control, 3 numbers of memory, horizon of 15 samples (1.5 s)"
    )
    assert lines[1:3] == ["shift registers: u.history (of u)", "blocks: 1, 4, 10"]
    words = [" ".join(line.split()) for line in lines]
    assert "u by references 0.5 a sample always holds t … t+14" in words
    assert "v -1 hard t+1 … t+15" in words
    assert "p 3 soft, 7 · v + as steep as the cost needs · v² t+1 … t+15" in words
    most = "4 iterations a sample at most"
    ends = f"until the residual is at most 1e-06, {most}, from the plan before alone"
    assert lines[-4] == (
        f"solver: interior point with the exact curvature of cost, plant and bounds, {ends}"
    )
    assert lines[-3].startswith("structure: condensed, as fewer products (3 numbers of memory, of ")
    assert "which windows leave 2 states" in lines[-3]
    # 2 states over 15 samples and 3 blocks: 2·2·3·15/2 + 2²·3·15/2 + 2·3²·15/6 + 3³/6
    assert lines[-2].startswith("  in 3 controls of the horizon at once (condensed, states ")
    assert "about 229 products" in lines[-2]
    assert lines[-1].startswith("  not stage by stage (staged, a Riccati recursion): about 1,440 ")


def test_states_that_only_the_cost_reads_are_among_the_states(tmp_path: Path) -> None:
    text = (
        "msnn: 1\nname: st\nsample_time: 0.1 s\ninputs: {u: 1}\n"
        "states: {x: {der: u - x}, e: {next: e + x, doc: what the cost sums}}\noutputs: {y: x}\n"
        'mpc: {horizon: 10, controls: [u], cost: "(x - 1)**2 + 0.01 * e**2"}\n'
    )
    (tmp_path / "st.msnn.yaml").write_text(text)
    model = load_model(tmp_path / "st.msnn.yaml")
    control = model.of(ControlProblem)
    assert control is not None
    assert "what the cost sums" not in interface_text(model.program)
    shown = interface_text(model.program, [control.program])
    table = shown.partition("state  holds")[2].partition("\n")[2].partition("\n\n")[0]
    assert [line.split()[0] for line in table.strip().splitlines()] == ["x", "e"]
    assert "what the cost sums" in table
