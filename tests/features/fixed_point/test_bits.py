"""Generated integers are those of the integer interpreter, in every build."""

from pathlib import Path

import pytest

from msnn.exports.export import write_export
from tests.conditions import require_tool
from tests.features.fixed_point.exported import fixed_model, gallery_text, planned, run_test_program
from tests.features.fixed_point.random_specs import random_spec

SPECS = ("reference", "battery", "heater", "engine_map", "quarter_car")
STRICT = ("-O1", "-Wall", "-Wextra", "-Wconversion", "-pedantic", "-Werror")
SANITIZED = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")

EDGES = """\
msnn: 1
name: edges
sample_time: 0.1 s
inputs:
  u: {range: [-1, 1]}
  bent: {range: [-0.03124, 0.03124]}
  last: {range: [-SMALL, SMALL]}
  below: {range: [-0.2 * SMALL, 0.2 * SMALL]}
states:
  x: {next: "x + SLOW * (u + 24 * bent)", range: [-1, 1], init: 0.5}
outputs:
  shifted: {expr: "concat(u, last, below)"}
  steep: {expr: tan(bent)}
  grows: {expr: "where(next(x) >= x, 1, -1)"}
"""


@pytest.mark.parametrize(
    ("dtype", "small", "slow"), [("q15", 1.5e-9, 3e-10), ("q31", 4e-19, 3e-10)]
)
def test_the_farthest_shifts_and_the_widest_cells(
    dtype: str, small: float, slow: float, tmp_path: Path
) -> None:
    """A shift by 30 or 62 bits, a value that lies below it, in q15 a cell of 2^15 words."""
    require_tool("gcc", "apt-get install gcc")
    text = EDGES.replace("0.2 * SMALL", f"{0.2 * small:.5g}").replace("SMALL", repr(small))
    plan = planned(fixed_model(tmp_path, text.replace("SLOW", repr(slow)), dtype))
    write_export(plan, {}, tmp_path / "c")
    source = (tmp_path / "c" / "src" / "edges.c").read_text(encoding="utf-8")
    farthest = 30 if dtype == "q15" else 62
    assert f"edges_rounded_{farthest}(" in source
    said = run_test_program(tmp_path / "c", plan.prefix, "gcc", (*STRICT, *SANITIZED))
    assert "golden steps agree" in said


@pytest.mark.parametrize("dtype", ["q15", "q31"])
@pytest.mark.parametrize("name", SPECS)
def test_gallery(name: str, dtype: str, tmp_path: Path) -> None:
    for tool in ("gcc", "clang"):
        require_tool(tool, f"apt-get install {tool}")
    plan = planned(fixed_model(tmp_path, gallery_text(name), dtype))
    write_export(plan, {}, tmp_path / "c")
    for compiler, flags in (("gcc", (*STRICT, *SANITIZED)), ("clang", STRICT)):
        said = run_test_program(tmp_path / "c", plan.prefix, compiler, flags)
        assert "golden steps agree" in said


@pytest.mark.parametrize("seed", range(6))
def test_random_models(seed: int, tmp_path: Path) -> None:
    """Whatever the model and the word outside its range: the same bits, no undefined behaviour."""
    require_tool("gcc", "apt-get install gcc")
    plan = planned(fixed_model(tmp_path, random_spec(seed), "q31" if seed % 3 == 2 else "q15"))
    write_export(plan, {}, tmp_path / "c")
    flags = (*STRICT, *SANITIZED)
    assert "agree" in run_test_program(tmp_path / "c", plan.prefix, "gcc", flags)


def test_the_same_model_gives_the_same_bytes(tmp_path: Path) -> None:
    plan = planned(fixed_model(tmp_path, gallery_text("reference"), "q15"))
    first = [path.read_bytes() for path in write_export(plan, {}, tmp_path / "a").files]
    again = [path.read_bytes() for path in write_export(plan, {}, tmp_path / "b").files]
    assert first == again
