"""Matrix products in fixed point are loops where that is shorter, with the same words."""

import subprocess
from pathlib import Path

import numpy as np
import pytest

from msnn.exports.export import write_export
from msnn.features.fixed_point.backend.integer_nodes import matrix_products
from msnn.features.fixed_point.compile.compile_integers import integer_program
from msnn.features.fixed_point.integers.program import Q15, IntegerNode, ReadWord, WeightedSum
from msnn.verification.proof_step import ARM_GCC
from tests.conditions import miss, require_tool
from tests.features.fixed_point.exported import (
    fixed_model,
    initial_weights,
    planned,
    run_test_program,
)

NETWORK = """\
msnn: 1
name: net
sample_time: 10 ms
inputs: {a: {range: [-1, 1]}, b: {range: [-2, 1]}, c: {range: [0, 3]}}
layers: {net: {mlp: {hidden: [16, 16]}}}
outputs: {y: "net(a, b, c)"}
"""

FILTER = """\
msnn: 1
name: net
sample_time: 10 ms
inputs: {u: {range: [-1, 1]}}
layers: {h: {fir: {window: 20}}}
outputs: {y: "h(u)"}
"""

MATRIX = """\
msnn: 1
name: net
sample_time: 10 ms
dims: {k: 8, row: 8}
inputs: {u: {dims: k, range: [-1, 1]}}
layers: {m: {linear: {out: row, bias: false}}}
outputs: {y: "m(u + OFFSET)"}
"""


def _sums(rows: int, terms: int) -> list[IntegerNode]:
    words = [
        IntegerNode(op=ReadWord("u", k), args=(), fraction=0, low=-9, high=9) for k in range(terms)
    ]
    args = tuple(range(terms))
    sums = [
        IntegerNode(
            op=WeightedSum(row, tuple(row + k + 1 for k in args)),
            args=args,
            fraction=0,
            low=-(2**20),
            high=2**20,
        )
        for row in range(rows)
    ]
    return [*words, *sums]


def test_rows_are_a_loop_where_that_is_shorter() -> None:
    assert matrix_products(_sums(8, 8), Q15.largest_word) == {8: tuple(range(8, 16))}
    assert matrix_products(_sums(2, 4), Q15.largest_word) == {}
    assert matrix_products(_sums(1, 40), Q15.largest_word) == {}
    assert matrix_products(_sums(8, 8), largest_word=5) == {}  # what is no word is no operand


@pytest.mark.parametrize("dtype", ["q15", "q31"])
@pytest.mark.parametrize("compiler", ["gcc", "clang"])
def test_loops_have_the_words_of_the_integers(compiler: str, dtype: str, tmp_path: Path) -> None:
    require_tool(compiler, f"apt-get install {compiler}")
    plan = planned(fixed_model(tmp_path, NETWORK, dtype))
    write_export(plan, {}, tmp_path / "c")
    source = (tmp_path / "c" / "src" / "net.c").read_text(encoding="utf-8")
    assert source.count("total") > 0
    flags = ("-O2", "-Wall", "-Wextra", "-Wconversion", "-Werror", "-fsanitize=undefined")
    said = run_test_program(tmp_path / "c", "net", compiler, (*flags, "-fno-sanitize-recover"))
    assert "golden steps agree" in said


def test_a_sum_of_two_weights_has_a_table_of_them(tmp_path: Path) -> None:
    require_tool("gcc", "apt-get install gcc")
    plan = planned(fixed_model(tmp_path, FILTER, "q15"))
    weights = {"h.weight": np.repeat([0.3, 0.7], 10)}
    write_export(plan, weights, tmp_path / "c")
    assert "golden steps agree" in run_test_program(tmp_path / "c", "net", "gcc", ("-O2",))


@pytest.mark.parametrize(("offset", "numbers"), [(-0.5, 2), (-0.5, 4), (0.5, 2)])
def test_rows_begin_with_numbers_of_their_own(offset: float, numbers: int, tmp_path: Path) -> None:
    """W (u + d) begins with W d, at the scale of sums, which no word holds: also where all are
    negative, or only two numbers."""
    require_tool("gcc", "apt-get install gcc")
    plan = planned(fixed_model(tmp_path, MATRIX.replace("OFFSET", str(offset)), "q15"))
    # the sum of a row depends on which weight is negative alone
    rows = [
        np.linspace(0.1, 0.8, 8) * np.where(np.arange(8) == r % numbers, -1, 1) for r in range(8)
    ]
    matrix = np.array([np.roll(row, r) for r, row in enumerate(rows)])
    weights = {**initial_weights(plan.program), "m.weight": matrix}
    integers = integer_program(plan.program, weights, Q15)
    (found,) = matrix_products(integers.step, Q15.largest_word).values()
    begins = [op.constant for row in found if isinstance(op := integers.step[row].op, WeightedSum)]
    assert len(begins) == 8
    assert len(set(begins)) == numbers
    assert min(map(abs, begins)) > Q15.largest_word
    write_export(plan, weights, tmp_path / "c")
    assert "golden steps agree" in run_test_program(tmp_path / "c", "net", "gcc", ("-O2",))


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_powers_of_two_that_no_word_holds_have_a_table_of_sums(sign: float, tmp_path: Path) -> None:
    require_tool("gcc", "apt-get install gcc")
    plan = planned(fixed_model(tmp_path, FILTER.replace("20", "16"), "q15"))
    # at the scale of the least one these are 1 … 2^16
    exponents = [8, 7, *range(5, -9, -1)]
    write_export(plan, {"h.weight": sign * np.exp2(exponents)}, tmp_path / "c")
    source = (tmp_path / "c" / "src" / "net.c").read_text(encoding="utf-8")
    assert "static const NET_PLACED net_sum_t table_1" in source
    assert "golden steps agree" in run_test_program(tmp_path / "c", "net", "gcc", ("-O2",))


def test_a_network_takes_less_than_its_terms_written_out(tmp_path: Path) -> None:
    """4.6 KB; with every term written out it was 6.9 KB."""
    if not ARM_GCC.is_there:
        miss(f"{ARM_GCC.command} is not installed: apt-get install {ARM_GCC.package}")
    plan = planned(fixed_model(tmp_path, NETWORK, "q15"))
    products = matrix_products(
        integer_program(plan.program, initial_weights(plan.program), Q15).step, Q15.largest_word
    )
    assert [len(rows) for rows in products.values()] == [16]
    write_export(plan, {}, tmp_path / "c")
    built = tmp_path / "net.o"
    command = ["arm-none-eabi-gcc", "-mcpu=cortex-m0", "-mthumb", "-Os", "-std=c99", "-c"]
    paths = [str(tmp_path / "c" / "src" / "net.c"), f"-I{tmp_path / 'c' / 'include'}"]
    subprocess.run([*command, *paths, "-o", str(built)], check=True)
    table = subprocess.run(
        ["arm-none-eabi-size", str(built)], check=True, capture_output=True, text=True
    ).stdout
    assert int(table.splitlines()[1].split()[0]) < 5200
