"""The build systems that an exported folder is made for find what it holds."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest
import yaml

from backends.c import write_c
from spec_schema.version import __version__
from tests.backends.c.c_programs import closed_sample
from tests.conditions import require_tool

NAME = "joint_arm"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_c(closed_sample(NAME), {}, tmp_path / NAME)
    return tmp_path / NAME


def _run(*command: str | Path) -> str:
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_cmake_installs_a_package(folder: Path, tmp_path: Path) -> None:
    cmake = require_tool("cmake", install="apt install cmake")
    build, installed = tmp_path / "build", tmp_path / "installed"
    _run(cmake, "-S", folder, "-B", build, f"-DCMAKE_INSTALL_PREFIX={installed}")
    _run(cmake, "--build", build)
    _run(cmake, "--install", build)
    user = tmp_path / "user"
    user.mkdir()
    (user / "main.c").write_text(
        f'#include "{NAME}.h"\nint main(void)\n{{\n    return (int){NAME}_selftest();\n}}\n',
        encoding="utf-8",
    )
    (user / "CMakeLists.txt").write_text(
        "cmake_minimum_required(VERSION 3.13)\n"
        "project(user C)\n"
        f"find_package({NAME} CONFIG REQUIRED)\n"
        "add_executable(user main.c)\n"
        f"target_link_libraries(user PRIVATE {NAME}::{NAME})\n",
        encoding="utf-8",
    )
    _run(cmake, "-S", user, "-B", user / "build", f"-DCMAKE_PREFIX_PATH={installed}")
    _run(cmake, "--build", user / "build")
    _run(user / "build" / "user")


def test_zephyr_finds_the_files_that_its_module_names(folder: Path) -> None:
    module = yaml.safe_load((folder / "zephyr" / "module.yml").read_text(encoding="utf-8"))
    assert module["name"] == NAME
    assert (folder / module["build"]["kconfig"]).is_file()
    script = folder / module["build"]["cmake"] / "CMakeLists.txt"
    words = script.read_text(encoding="utf-8").replace(")", " ").split()
    sources = {script.parent / word for word in words if word.endswith(".c")}
    assert {path.resolve() for path in sources} == set((folder / "src").resolve().glob("*.c"))
    symbol = (folder / module["build"]["kconfig"]).read_text(encoding="utf-8").split()[1]
    assert f"if(CONFIG_{symbol})" in script.read_text(encoding="utf-8")


def test_arduino_compiles_what_is_in_src(folder: Path, tmp_path: Path) -> None:
    lines = (folder / "library.properties").read_text(encoding="utf-8").splitlines()
    properties = dict(line.split("=", 1) for line in lines)
    assert (properties["name"], properties["version"]) == (NAME, __version__)
    assert (folder / "src" / properties["includes"]).is_file()
    tool = {
        ending: require_tool(
            f"arm-none-eabi-{name}",
            install="apt install gcc-arm-none-eabi libnewlib-arm-none-eabi",
        )
        for ending, name in ((".c", "gcc"), (".cpp", "g++"))
    }
    sketch = tmp_path / "sketch.cpp"
    sketch.write_text(
        f"#include <{properties['includes']}>\n"
        f"int main() {{ return static_cast<int>({NAME}_selftest()); }}\n",
        encoding="utf-8",
    )
    core = ["-mcpu=cortex-m4", "-mthumb", "-Os", "-Wall", "-Wextra", "-Werror"]
    standard = {".c": "-std=gnu11", ".cpp": "-std=gnu++17"}
    objects: list[Path] = []
    for source in [*sorted((folder / "src").glob("*.c")), sketch]:
        objects.append(tmp_path / f"{source.stem}.o")
        command = [tool[source.suffix], *core, standard[source.suffix], f"-I{folder / 'src'}"]
        _run(*command, "-c", source, "-o", objects[-1])
    program = tmp_path / "sketch.elf"
    _run(tool[".c"], *core, *objects, "-specs=nosys.specs", "-lm", "-o", program)
