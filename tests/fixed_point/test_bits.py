"""Generated integers are those of the integer interpreter, in every build."""

from pathlib import Path

import pytest

from msnn.exports.export import write_export
from tests.conditions import require_tool
from tests.fixed_point.exported import fixed_model, gallery_text, planned, run_test_program
from tests.fixed_point.random_specs import random_spec

SPECS = ("reference", "battery", "heater", "engine_map", "quarter_car")
STRICT = ("-O1", "-Wall", "-Wextra", "-Wconversion", "-pedantic", "-Werror")
SANITIZED = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")


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
