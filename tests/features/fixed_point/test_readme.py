"""The README of an export in fixed point does what it says."""

import subprocess
from pathlib import Path

import pytest

from msnn.exports.export import write_export
from tests.conditions import require_tool
from tests.features.fixed_point.exported import fixed_model, gallery_text, planned


@pytest.mark.parametrize("name", ["heater", "quarter_car"])
def test_its_example_builds_and_runs(name: str, tmp_path: Path) -> None:
    require_tool("cc", "apt-get install gcc")
    plan = planned(fixed_model(tmp_path, gallery_text(name), "q15"))
    folder = tmp_path / "c"
    write_export(plan, {}, folder)
    text = (folder / "README.md").read_text(encoding="utf-8")
    (folder / "main.c").write_text(text.split("```c\n")[1].split("```")[0], encoding="utf-8")
    command = next(line for line in text.splitlines() if line.startswith("    cc ")).split()
    strict = ["-Wall", "-Wextra", "-Wconversion", "-Werror", "-o", "example"]
    subprocess.run([*command, *strict], cwd=folder, check=True)
    said = subprocess.run([folder / "example"], check=True, capture_output=True, text=True).stdout
    assert said.startswith("reset 0\n")
    assert said.count("status 0 ") == 10


def test_headers_are_found_beside_the_sources_too(tmp_path: Path) -> None:
    require_tool("cc", "apt-get install gcc")
    plan = planned(fixed_model(tmp_path, gallery_text("heater"), "q15"))
    write_export(plan, {}, tmp_path / "c")
    source = f'#include "{plan.prefix}_real.h"\n'
    (tmp_path / "sketch.c").write_text(source, encoding="utf-8")
    command = ["cc", "-std=c99", f"-I{tmp_path / 'c' / 'src'}", "-c", str(tmp_path / "sketch.c")]
    subprocess.run([*command, "-o", str(tmp_path / "sketch.o")], check=True)


@pytest.mark.parametrize("dtype", ["q15", "q31"])
def test_a_range_below_all_numbers_of_float32_builds(dtype: str, tmp_path: Path) -> None:
    require_tool("cc", "apt-get install gcc")
    text = "msnn: 1\nname: m\ninputs: {u: {range: [-1e-310, 1e-310]}}\noutputs: {y: 0.5 * u}\n"
    plan = planned(fixed_model(tmp_path, text, dtype))
    write_export(plan, {}, tmp_path / "c")
    command = ["cc", "-std=c99", "-Wall", "-Wextra", "-Wconversion", "-Werror", "-fsyntax-only"]
    subprocess.run([*command, str(tmp_path / "c" / "include" / "m_real.h")], check=True)
