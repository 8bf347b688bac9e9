"""The build systems that an exported folder is made for find what it holds."""

from __future__ import annotations

import ctypes
import re
import subprocess
from pathlib import Path

import pytest
import yaml

from backends.c import write_c
from backends.c.folder.file_texts import NUMBER
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


_PLUGIN = """#include "joint_arm.h"
int plugin(void);
int plugin(void) { return (int)joint_arm_selftest(); }
"""


def _as_package(folder: Path, build: Path) -> list[str | Path]:
    installed = build.parent / "installed"
    _run("cmake", "-S", folder, "-B", build, f"-DCMAKE_INSTALL_PREFIX={installed}")
    _run("cmake", "--build", build, "--target", "install")
    return [f"-DCMAKE_PREFIX_PATH={installed}"]


@pytest.mark.parametrize("way", ["find_package", "add_subdirectory"])
def test_a_shared_library_links_the_library_of_cmake(
    way: str, folder: Path, tmp_path: Path
) -> None:
    require_tool("cmake", install="apt install cmake")
    options = _as_package(folder, tmp_path / "build") if way == "find_package" else []
    user = tmp_path / "user"
    user.mkdir()
    (user / "plugin.c").write_text(_PLUGIN, encoding="utf-8")
    found = f"find_package({NAME} 0.1 CONFIG REQUIRED)"
    if way == "add_subdirectory":
        found = f"add_subdirectory({folder} {NAME})"
    (user / "CMakeLists.txt").write_text(
        "cmake_minimum_required(VERSION 3.13)\n"
        f"project(user C)\n{found}\n"
        "add_library(plugin SHARED plugin.c)\n"
        f"target_link_libraries(plugin PRIVATE {NAME}::{NAME})\n",
        encoding="utf-8",
    )
    _run("cmake", "-S", user, "-B", user / "build", *options)
    _run("cmake", "--build", user / "build")
    assert ctypes.CDLL(str(user / "build" / "libplugin.so")).plugin() == 0


def test_find_package_compares_versions(folder: Path, tmp_path: Path) -> None:
    require_tool("cmake", install="apt install cmake")
    options = _as_package(folder, tmp_path / "build")
    user = tmp_path / "user"
    user.mkdir()
    major, minor, *_ = map(int, NUMBER.split("."))
    versions = (f"{major}.{minor}", f"{major}.{minor + 1}", f"{major + 1}", f"{major}.{minor}.99")
    (user / "CMakeLists.txt").write_text(
        "cmake_minimum_required(VERSION 3.13)\nproject(user C)\n"
        + "".join(
            f'find_package({NAME} {version} CONFIG QUIET)\nmessage("{version}=${{{NAME}_FOUND}}")\n'
            for version in versions
        ),
        encoding="utf-8",
    )
    done = subprocess.run(
        ["cmake", "-S", user, "-B", user / "build", *options],
        capture_output=True,
        text=True,
        check=True,
    )
    said = dict(re.findall(r"^([\d.]+)=(\d)$", done.stderr, re.MULTILINE))
    assert said == dict(zip(versions, "1000", strict=True))


def test_cmake_optimises_unless_told_otherwise(folder: Path, tmp_path: Path) -> None:
    require_tool("cmake", install="apt install cmake")
    for build_type, options in (("Release", []), ("Debug", ["-DCMAKE_BUILD_TYPE=Debug"])):
        build = tmp_path / build_type
        _run("cmake", "-S", folder, "-B", build, "-DCMAKE_EXPORT_COMPILE_COMMANDS=ON", *options)
        commands = (build / "compile_commands.json").read_text(encoding="utf-8")
        assert ("-O3" in commands) == (build_type == "Release")


def test_a_board_without_shared_libraries_gets_fixed_addresses(
    folder: Path, tmp_path: Path
) -> None:
    """Position-independent code of a board needs a loader that it does not have."""
    require_tool("cmake", install="apt install cmake")
    require_tool("arm-none-eabi-gcc", install="apt install gcc-arm-none-eabi")
    options = ["-DCMAKE_SYSTEM_NAME=Generic", "-DCMAKE_C_COMPILER=arm-none-eabi-gcc"]
    options += ["-DCMAKE_TRY_COMPILE_TARGET_TYPE=STATIC_LIBRARY"]
    build = tmp_path / "build"
    _run("cmake", "-S", folder, "-B", build, "-DCMAKE_EXPORT_COMPILE_COMMANDS=ON", *options)
    assert "-fPIC" not in (build / "compile_commands.json").read_text(encoding="utf-8")


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
