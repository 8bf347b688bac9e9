"""The command line starts light: what is only looked at waits for no numerical library."""

from __future__ import annotations

from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

from tests.cli.command_line import in_new_process

_HEAVY = (
    "casadi",
    "h5py",
    "jinja2",
    "matplotlib",
    "onnx",
    "onnxruntime",
    "pandas",
    "pint",
    "polars",
    "pyarrow",
    "rich",
    "safetensors",
    "scipy",
    "torch",
)
_START = f"""
import sys
from msnn.cli.application import run
code = run(sys.argv[1:])
loaded = [name for name in {_HEAVY!r} if name in sys.modules]
print("loaded:", *loaded, file=sys.stderr)
sys.exit(code)
"""


@pytest.mark.parametrize(
    "arguments",
    [
        ("--help",),
        ("train", "--help"),
        ("check", "plant.msnn.yaml"),
        ("show", "plant.msnn.yaml"),
        ("show", "--program", "plant.msnn.yaml"),
        ("check", "--format", "sarif", "plant.msnn.yaml"),
        ("explain", "E0301"),
        ("schema",),
        ("doctor",),
        ("fmt", "--check", "plant.msnn.yaml"),
        ("diff", "plant.msnn.yaml", "plant.msnn.yaml"),
        ("show", "--resolved", "plant.msnn.yaml"),
        ("show", "--graph", "mermaid", "plant.msnn.yaml"),
        ("show", "--latex", "plant.msnn.yaml"),
        ("show", "--interface", "plant.msnn.yaml"),
        ("compile", "plant.msnn.yaml"),
        ("validate", "--initial", "plant.msnn.yaml", "--set", "validate=[{of: x_next}]"),
    ],
    ids=" ".join,
)
def test_these_import_nothing_heavy(project: Path, arguments: tuple[str, ...]):
    said = in_new_process(arguments, project, start=_START)
    assert said.code == 0, said.err
    assert said.err.splitlines()[-1] == "loaded:"


_LISTED = """
import sys
before = set(sys.modules)
from msnn.cli.application import run
code = run(sys.argv[1:])
print(*sorted(set(sys.modules) - before), sep="\\n", file=sys.stderr)
sys.exit(code)
"""
_DISTRIBUTIONS = {"numpy", "pydantic", "PyYAML", "typer"}
_DISTRIBUTIONS_OF_THOSE = {
    "annotated-doc",
    "annotated-types",
    "pydantic_core",
    "shellingham",
    "typing-inspection",
    "typing_extensions",
}
_WHOLE_PACKAGES = {
    "compiler",
    "compiler.layers",
    "compiler.linking",
    "compiler.lowering",
    "compiler.passes",
    "msnn.cli",
    "spec_schema",
    "spec_schema.errors",
}
_MODULES = {
    "backends": {"identifiers"},
    "msnn": {
        "durations",
        "exporting",
        "failures",
        "model_file",
        "package_names",
        "rollout_plan",
        "safetensors_file",
        "spec_hash",
        "submodel_weights",
        "summary",
        "tables",
        "validation_plan",
        "workflow_checks",
    },
    "msnn.data": {"dataset", "file_sets", "formats", "reads", "starts"},
    "msnn.training": {
        "curriculum",
        "learning_rate",
        "stage_plan",
        "torch_optimizer_options",
    },
}
"""Of packages that mostly do other things, what plans the sections of a spec."""


def test_check_imports_this_and_nothing_else(project: Path):
    said = in_new_process(("check", "plant.msnn.yaml"), project, start=_LISTED)
    assert said.code == 0, said.err
    loaded = set(said.err.splitlines())
    installed = packages_distributions()
    distributions = {name for module in loaded for name in installed.get(_top(module), ())}
    assert distributions - {"msnn"} == _DISTRIBUTIONS | _DISTRIBUTIONS_OF_THOSE
    packages = _WHOLE_PACKAGES | set(_MODULES)
    ours = {module for module in loaded if _top(module) in {_top(name) for name in packages}}
    by_package = {package: set[str]() for package in packages}
    for module in ours - packages:
        package, _, name = module.rpartition(".")
        assert package in packages, module
        by_package[package].add(name)
    assert {package: by_package[package] for package in _MODULES} == _MODULES


def _top(module: str) -> str:
    return module.partition(".")[0]


_COUNTED = """
import atexit, os, sys
atexit.register(lambda: print(len(os.listdir("/proc/self/task")), file=sys.stderr))
from msnn.cli.main import main
main()
"""


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="counts threads as Linux does")
def test_check_starts_no_threads(project: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    said = in_new_process(("check", "plant.msnn.yaml"), project, start=_COUNTED)
    assert (said.code, said.err) == (0, "1\n")  # that of Python itself


def test_importing_msnn_imports_next_to_nothing(project: Path):
    start = (
        "import sys, msnn; print(*(m for m in ('numpy', 'pydantic', 'yaml') if m in sys.modules))"
    )
    said = in_new_process((), project, start=start)
    assert (said.code, said.out) == (0, "\n")
