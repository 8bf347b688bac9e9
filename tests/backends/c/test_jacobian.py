"""Linearising in C: the bits of the interpreter's Jacobian, and a step that nothing changes."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import numpy as np
import pytest

from backends.c import COptions, write_c
from backends.c.interface.status import StatusBit
from backends.c.selftest.golden_vectors import GoldenVectors
from compiler.ir.program import Declared
from compiler.jacobian.jacobian import JacobianInterpreter, jacobian
from compiler.passes.to_step_form import to_step_form
from tests.backends.c.c_programs import (
    assert_same_bits,
    built,
    closed_sample,
    golden,
    write_library,
)
from tests.backends.c.small_programs import conditions, filtered, starting_states, swapped_states
from tests.conditions import require_tool
from tests.golden import assert_golden
from tests.language.compiled import compiled
from tests.programs import SAMPLES

PROGRAMS = {
    **{name: lambda name=name: closed_sample(name) for name in SAMPLES},
    "clamp": lambda: filtered("clamp", (-2.0, 3.0), cells=True),
    "hold": lambda: filtered("hold", (-2.0, 3.0), cells=True),
    "conditions": conditions,
    "starting_states": starting_states,
    "swapped_states": swapped_states,
}
OPTIONS = {
    "const": COptions(extras=("jacobian", "parameter_jacobian")),
    "tunable": COptions(params="tunable", ring="double", extras=("parameter_jacobian",)),
    "inline": COptions(params="inline", unroll=1, extras=("jacobian", "parameter_jacobian")),
    "constant_time": COptions(constant_time=True, extras=("jacobian",)),
    "double": COptions(dtype="float64", extras=("jacobian",)),
}
STEPS = 40
_OF_RESULTS = (
    StatusBit.STATE_OUT_OF_RANGE | StatusBit.EQUATION_OUT_OF_RANGE | StatusBit.STATE_NOT_FINITE
)
DOUBLE = 1e-9
"""In float64 numpy's functions are judge, and errors grow from step to step."""


EVERY_OPTION = ("joint_arm", "swapped_states", "clamp")
"""A network, states that read each other, an input policy: programs that get all options."""
PAIRS = [
    (name, option)
    for number, name in enumerate(PROGRAMS)
    for turn, option in enumerate(OPTIONS)
    if name in EVERY_OPTION or (turn - number) % len(OPTIONS) < 2
]
"""Every other program with two options, its neighbours with others."""


@pytest.mark.parametrize(("name", "option"), PAIRS)
def test_slopes_are_the_interpreters(name: str, option: str, tmp_path: Path) -> None:
    compiler = require_tool("gcc", install="apt install gcc")
    program, options = PROGRAMS[name](), OPTIONS[option]
    step = built(program, tmp_path, options, [compiler])
    assert step.selftest() == 0
    vectors = golden(program, options, STEPS, seed=3)
    step.reset({**vectors.start.windows, **vectors.start.supplied})
    numbers = sum(int(np.prod([a.size for a in state.axes])) for state in program.states)
    for k in range(STEPS):
        inputs = {name: values[k] for name, values in vectors.inputs.items()}
        before = step.states()
        slopes, status = step.linearize(inputs)
        assert_same_bits(step.states(), before)
        if numbers:
            x = step.get_state(numbers)
            assert np.array_equal(x, np.concatenate([v.ravel() for v in before.values()]), True)
            step.set_state(x)
        found, of_step = step.step(inputs)
        assert of_step == vectors.status[k]
        assert status == of_step & ~_OF_RESULTS
        expected = _step_of(vectors, k)
        if options.is_exact:
            assert_same_bits(slopes, expected)
            assert_same_bits(found, {n: v[k] for n, v in vectors.outputs.items()})
        else:
            for matrix, value in expected.items():
                scale = max(1.0, float(np.abs(value[np.isfinite(value)]).max(initial=0.0)))
                np.testing.assert_allclose(slopes[matrix], value, rtol=0.0, atol=DOUBLE * scale)


BUFFERED = """
inputs: {u: {}}
states:
  a: {next: "0.5 * a + sin(b) * u[t-2]", init: 0.1}
  b: {next: "tanh(a * e) + mean(u.past(5))", init: b.meas}
equations: {e: {expr: "0.2 * e[t-1] + a * u", history: 0}}
outputs: {y: "a * e + u"}
"""


def test_the_jacobian_of_declared_states_is_a_part_of_the_whole(tmp_path: Path) -> None:
    program = to_step_form(compiled(BUFFERED))
    declared = [s.name for s in program.states if isinstance(s.origin, Declared)]
    assert len(declared) < len(program.states)
    whole, part = (jacobian(program, declared_only=only) for only in (False, True))
    places = [
        member.first + k
        for member in whole.states.members
        if member.name in declared
        for k in range(member.size)
    ]
    options = COptions(extras=("state_jacobian",))
    step = built(program, tmp_path, options)
    assert step.selftest() == 0
    vectors = golden(program, options, STEPS, seed=3)
    step.reset({**vectors.start.windows, **vectors.start.supplied})
    full = golden(program, COptions(extras=("jacobian",)), STEPS, seed=3)
    for k in range(STEPS):
        inputs = {name: values[k] for name, values in vectors.inputs.items()}
        slopes, _ = step.linearize(inputs)
        assert_same_bits(slopes, _step_of(vectors, k))
        np.testing.assert_array_equal(slopes["A"], full.slopes["A"][k][np.ix_(places, places)])
        np.testing.assert_array_equal(slopes["B"], full.slopes["B"][k][places])
        np.testing.assert_array_equal(slopes["C"], full.slopes["C"][k][:, places])
        before = step.states()
        x = step.get_state(len(places))
        np.testing.assert_array_equal(x, [before["a"], before["b"]])
        step.set_state(x)
        assert_same_bits(step.states(), before)
        step.step(inputs)
    assert part.states.size == len(places)


def test_setting_declared_states_leaves_buffers_waiting_for_their_first_sample(
    tmp_path: Path,
) -> None:
    step = built(to_step_form(compiled(BUFFERED)), tmp_path, COptions(extras=("state_jacobian",)))
    step.init()
    step.set_state([0.25, 0.5])
    assert step.step({"u": 0.75})[1] == StatusBit.UNINITIALISED
    assert step.step({"u": 0.75})[1] == 0
    (filled,) = (v for name, v in step.states().items() if name == "u.history")
    np.testing.assert_array_equal(filled, np.full(filled.shape, 0.75))


def _step_of(vectors: GoldenVectors, k: int) -> dict[str, np.ndarray]:
    return {name: values[k] for name, values in vectors.slopes.items() if values[k].size}


@pytest.mark.parametrize("name", PROGRAMS)
def test_the_step_is_the_same_with_and_without(name: str, tmp_path: Path) -> None:
    program = PROGRAMS[name]()
    plain, extended = COptions(prefix="m"), COptions(prefix="m", extras=("jacobian",))
    functions: list[str] = []
    write_c(program, {}, tmp_path / "plain", plain)
    write_library(program, tmp_path / "extended", extended)
    for folder in (tmp_path / "plain", tmp_path / "extended"):
        source = (folder / "src" / "m.c").read_text(encoding="utf-8")
        functions.append(
            source[source.index("/* Initialises the state without") :].split(
                "/* Computes the slopes"
            )[0]
        )
    assert functions[0].rstrip() == functions[1].rstrip()
    assert "jacobian" not in "".join(p.read_text() for p in (tmp_path / "plain").rglob("*.[ch]"))


def test_hold_remembers_nothing_that_was_only_linearised(tmp_path: Path) -> None:
    compiler = require_tool("gcc", install="apt install gcc")
    program = filtered("hold", (-2.0, 3.0), cells=False)
    step = built(program, tmp_path, COptions(extras=("jacobian",)), [compiler])
    step.init()
    (name,) = (signal.name for signal in program.signals)
    step.step({name: 1.0})
    states = step.states()
    step.linearize({name: 2.5})
    after, status = step.step({name: np.nan})
    step.init()
    step.step({name: 1.0})
    assert_same_bits(step.states(), states)
    expected, _ = step.step({name: np.nan})
    assert_same_bits(after, expected)
    assert status & 8


def test_the_same_bytes_again(tmp_path: Path) -> None:
    program, options = closed_sample("joint_arm"), OPTIONS["const"]
    first = write_c(program, {}, tmp_path / "first", options)
    second = write_c(program, {}, tmp_path / "second", options)
    assert [p.read_bytes() for p in first] == [p.read_bytes() for p in second]


@pytest.mark.parametrize("name", ["spring_damper_rk4", "fir_closed_loop"])
def test_the_code_is_as_accepted(name: str, tmp_path: Path, accept: bool) -> None:
    options = COptions(prefix=name, extras=("jacobian",))
    write_library(closed_sample(name), tmp_path, options)
    source = (tmp_path / "src" / f"{name}.c").read_text(encoding="utf-8")
    expected = Path(__file__).parents[2] / "golden" / f"c_jacobian_{name}"
    assert_golden(
        expected / f"{name}_linearize.c",
        source[source.index("/* Computes the slopes") :],
        accept=accept,
    )
    header = (tmp_path / "include" / f"{name}.h").read_text(encoding="utf-8")
    shown = re.search(r"/\* x: .*?(?=\n/\* Inputs of a step\. \*/)", header, re.DOTALL)
    assert shown is not None
    assert_golden(expected / f"{name}_vectors.h", shown[0], accept=accept)


def test_the_filter_in_the_readme_predicts(tmp_path: Path) -> None:
    """Its covariance after a few steps is A P A^T + Q of the interpreter's A."""
    compiler = require_tool("gcc", install="apt install gcc")
    program, options = closed_sample("spring_damper_rk4"), COptions(extras=("jacobian",))
    write_c(program, {}, tmp_path, options)
    (code,) = re.findall(
        r"```c\n(#include \"spring.*?)```", (tmp_path / "README.md").read_text(), re.DOTALL
    )
    prefix = "spring_damper_rk4"
    main = tmp_path / "main.c"
    main.write_text(
        f"""#include <stdio.h>
{code}
int main(void)
{{
    {prefix}_state_t s;
    {prefix}_in_t u = {{0}};
    {prefix}_out_t y;
    {prefix}_real P[2][2] = {{{{1, 0}}, {{0, 1}}}};
    const {prefix}_real Q[2][2] = {{{{0.5f, 0}}, {{0, 0.25f}}}};
    {prefix}_init(&s, &{prefix}_params_default);
    for (int step = 0; step < 3; step++) {{
        predict(&s, &u, &y, P, Q);
    }}
    printf("%.9g %.9g %.9g %.9g", P[0][0], P[0][1], P[1][0], P[1][1]);
    return 0;
}}
""",
        encoding="utf-8",
    )
    sources = [str(path) for path in (tmp_path / "src").glob("*.c")]
    strict = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-ffp-contract=off"]
    command = [compiler, *strict, f"-I{tmp_path / 'include'}", str(main), *sources]
    subprocess.run([*command, "-o", str(tmp_path / "main"), "-lm"], check=True)
    said = subprocess.run([str(tmp_path / "main")], check=True, capture_output=True, text=True)

    slopes = jacobian(program)
    state = {"x": np.zeros(1), "v": np.zeros(1)}
    log = {"F": np.zeros(1)}
    a = JacobianInterpreter(slopes, program).matrices(log, 0, state)["A"][0]
    p, q = np.eye(2), np.diag([0.5, 0.25])
    for _ in range(3):
        p = a @ p @ a.T + q
    found = np.array([float(word) for word in said.stdout.split()]).reshape(2, 2)
    np.testing.assert_allclose(found, p, rtol=1e-5)  # three steps in single precision
