"""Ranges of equations: what they declare, in every target, and who acts on them."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
import pytest

from backends.c import COptions
from backends.c.interface.status import StatusBit
from compiler.interpreter.interpreter import Interpreter
from compiler.ir.program import Program
from compiler.passes.limit_expected import limit_expected
from compiler.passes.retime import retime
from compiler.passes.simplify import prune_outputs
from compiler.passes.to_step_form import to_step_form
from compiler.program_file.file import program_from_json, program_to_json
from msnn.features.fixed_point.compile.compile_integers import integer_program
from msnn.features.fixed_point.integers.interpret import FixedStatus, initial, step
from msnn.features.fixed_point.integers.program import Q15, IntegerProgram
from msnn.reports.show import interface_record, interface_text
from spec_schema.diagnostics.diagnostic import SpecError
from tests.backends.c.c_programs import assert_same_bits, built, golden, replay
from tests.features.fixed_point.exported import fixed_model, initial_weights, planned
from tests.language.compiled import codes, compiled
from tests.language.submodels.submodels import model_of
from tests.language.targets.every_backend import assert_backends_agree

SPEC = """
dims: {joint: 2}
inputs: {u: {unit: m, range: [-2 m, 320 cm]}, q: {dims: joint, range: [-1, 1]}}
states: {s: {unit: m, next: "0.5 * s + e", range: [-4 m, 4000 mm]}}
equations:
  e: {expr: "0.5 * u", unit: m, range: [-0.9 m, 150 cm]}
  f: {expr: "tanh(2 * q * part(q, 0))", range: [-0.9, 0.95]}
  past: {expr: "2 * e[t-2:t]", range: [-1.9, 3.1]}
  unused: {expr: 3 * u, range: [0, 1]}
outputs:
  y: "s + sum(past)"
  z: "sum(f[t-3:t])"
"""


def _ranges(program: Program) -> dict[str, set[tuple[float, float]]]:
    found: dict[str, set[tuple[float, float]]] = {}
    for entry in program.expected:
        found.setdefault(entry.name, set()).add(entry.range)
    return found


def test_a_range_is_in_the_unit_of_what_it_is_of() -> None:
    program = compiled(SPEC)
    assert _ranges(program) == {"e": {(-0.9, 1.5)}, "f": {(-0.9, 0.95)}, "past": {(-1.9, 3.1)}}
    assert program.signal("u").range == (-2.0, 3.2)
    assert program.state("s").range == (-4.0, 4.0)


def test_the_unit_of_an_equation_may_be_inferred() -> None:
    text = "inputs: {u: km}\nequations: {e: {expr: 2 * u, range: [-50 m, 1 km]}}\noutputs: {y: e}\n"
    (entry,) = compiled(text).expected
    assert entry.range == (-0.05, 1.0)


@pytest.mark.parametrize(
    ("limits", "code"),
    [("[1 s, 2 s]", "E0503"), ("[2, 1]", "E0224"), ("[1 km, 2 m]", "E0224"), ("[0, a]", "E0218")],
)
def test_limits_that_make_no_range(limits: str, code: str) -> None:
    equation = f"{{expr: 2 * u, range: {limits}}}"
    assert codes(f"inputs: {{u: m}}\nequations: {{e: {equation}}}\noutputs: {{y: e}}") == [code]
    assert codes(f"inputs: {{u: {{unit: m, range: {limits}}}}}\noutputs: {{y: u}}") == [code]


def test_a_range_computes_nothing_and_goes_with_what_needs_the_value() -> None:
    ranged = compiled(SPEC)
    plain = compiled(re.sub(r"(expr: [^\n]*), range: \[.*\]\}", r"\1}", SPEC))
    assert not plain.expected
    assert replace(ranged, expected=()) == plain
    assert _ranges(prune_outputs(ranged, ["z"])).keys() == {"f"}


def test_a_program_file_keeps_ranges() -> None:
    program = compiled(SPEC)
    assert program_from_json(program_to_json(program), "test") == program


def test_what_an_interface_says_of_ranges() -> None:
    text = SPEC + "export: {c: {outputs: [e, y]}}\n"
    found = {
        output["name"]: output["range"] for output in interface_record(compiled(text))["outputs"]
    }
    assert found == {"y": None, "z": None, "e": [-0.9, 1.5]}
    assert re.search(r"^past +m +-1.9 … 3.1$", interface_text(compiled(SPEC)), re.MULTILINE)


def test_an_input_of_a_sub_model_passes_its_range_to_what_is_connected(tmp_path: Path) -> None:
    part = "inputs: {v: {unit: m, range: [0, 2]}}\noutputs: {w: 2 * v}"
    whole = """
        inputs: {u: m}
        use: {part: {spec: part.yaml}}
        connect: {part.v: 2 * u}
        outputs: {y: part.w}
    """
    program = model_of(tmp_path, whole, part=part).program
    assert [(entry.name, entry.range) for entry in program.expected] == [("part.v", (0.0, 2.0))]


def test_every_backend_computes_the_same_with_ranges() -> None:
    random = np.random.default_rng(3)
    log = {"u": random.normal(size=20), "q": random.normal(size=(20, 2))}
    assert_backends_agree(SPEC, log, [5, 9])


# ---- float C


@pytest.mark.parametrize("constant_time", [False, True])
@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("retimed", [False, True])
def test_c_reports_equations_outside_their_range(
    retimed: bool, dtype: Literal["float32", "float64"], constant_time: bool, tmp_path: Path
) -> None:
    program = to_step_form(compiled(SPEC))
    program = retime(program, fixed_parameters=True) if retimed else program
    options = COptions(dtype=dtype, constant_time=constant_time)
    vectors = golden(program, options, 80, seed=4)
    left = (vectors.status & StatusBit.EQUATION_OUT_OF_RANGE) != 0
    assert left.any()
    assert not left.all()
    outputs, status = replay(built(program, tmp_path, options), vectors)
    if dtype == "float32":
        assert_same_bits(outputs, vectors.outputs)
    np.testing.assert_array_equal(status, vectors.status)


def test_c_reports_the_step_in_which_a_value_leaves(tmp_path: Path) -> None:
    program = to_step_form(
        compiled("inputs: {u: m}\nequations: {e: {expr: 2 * u, range: [-1, 1]}}\noutputs: {y: e}")
    )
    step = built(program, tmp_path, COptions(dtype="float64"))
    step.reset({})
    outputs, status = step.run({"u": np.array([0.5, 0.6, -0.5, -0.51, np.nan])}, 5)
    outside = int(StatusBit.EQUATION_OUT_OF_RANGE)
    assert status.tolist() == [0, outside, 0, outside, outside | int(StatusBit.NOT_A_NUMBER)]
    np.testing.assert_array_equal(outputs["y"], [1.0, 1.2, -1.0, -1.02, np.nan])


def test_retimed_windows_are_checked_when_a_sample_is_new() -> None:
    text = """
        inputs: {u: m}
        equations:
          e: {expr: 2 * u, range: [0, 1]}
          f: {expr: "tanh(e[t-9:t] / 1)", range: [0, 0.5]}
        outputs: {y: sum(f)}
    """
    program = retime(to_step_form(compiled(text)), fixed_parameters=True)
    shapes = {entry.name: program.step[entry.node].type.shape for entry in program.expected}
    assert shapes == {"e": (), "f": ()}


# ---- fixed point


def _integers(folder: Path, text: str) -> IntegerProgram:
    head = "msnn: 1\nname: model\nsample_time: 1 s\n"
    plan = planned(fixed_model(folder, head + text, "q15"))
    return integer_program(plan.program, initial_weights(plan.program), Q15)


def test_fixed_point_keeps_an_equation_in_its_range_and_says_so(tmp_path: Path) -> None:
    text = """\
inputs: {u: {range: [-1, 1]}}
equations: {e: {expr: 3 * u, range: [-2, 1.5]}}
outputs: {y: e}
"""
    program = _integers(tmp_path, text)
    ((port, _),) = program.outputs
    (entry,) = program.inputs
    state = initial(program)
    for u, y, status in [(0.5, 1.5, 0), (0.6, 1.5, 64), (-0.66, -1.98, 0), (-0.9, -2.0, 64)]:
        word = round(float(np.ldexp(u, entry.port.fraction)))
        answer = step(program, state, {"u": [word]})
        assert answer.status == FixedStatus(status)
        # one word of the input and one of the output
        assert np.ldexp(answer.outputs["y"][0], -port.fraction) == pytest.approx(y, abs=3e-4)


def test_a_range_bounds_what_nothing_else_does(tmp_path: Path) -> None:
    """A filter that is driven by a function of itself has a bound only by that of the function."""
    text = """\
inputs: {u: {range: [-1, 1]}}
states: {x: {next: 0.5 * x + e}}
equations: {e: {expr: u * x * x + u, range: [-2, 2]}}
outputs: {y: x}
"""
    program = _integers(tmp_path, text)
    (memory,) = program.memories
    reach = float(np.ldexp(memory.high, -memory.fraction))
    assert 4.0 <= reach <= 4.5  # 2 / (1 - 0.5) and what roundings may add
    with pytest.raises(SpecError):
        _integers(tmp_path, text.replace(", range: [-2, 2]", ""))


def test_a_range_takes_no_bound_away(tmp_path: Path) -> None:
    """With e as a bounded drive alone x would be an integrator, which has no bound."""
    text = """\
inputs: {u: {range: [-1, 1]}}
states: {x: {next: x + 0.5 * e}}
equations: {e: {expr: u - x, range: [-3, 3]}}
outputs: {y: x}
"""
    (memory,) = _integers(tmp_path, text).memories
    assert float(np.ldexp(memory.high, -memory.fraction)) == pytest.approx(1.0, abs=0.1)


def test_limited_values_are_what_the_rest_of_the_step_uses() -> None:
    text = "inputs: {u: m}\nequations: {e: {expr: 2 * u, range: [-1, 1]}}\noutputs: {y: 10 * e}"
    judge = Interpreter(limit_expected(compiled(text)))
    rows = np.arange(3)
    found = judge.step({"u": np.array([0.25, 3.0, -3.0])}, rows, {}).outputs["y"]
    np.testing.assert_array_equal(found, [5.0, 10.0, -10.0])
