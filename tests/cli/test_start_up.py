"""The command line starts light: what is only looked at waits for no numerical library."""

from __future__ import annotations

from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

from tests.cli.command_line import in_new_process

_HEAVY = (
    "casadi",
    "fmpy",
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
        ("show", "--graph", "svg", "plant.msnn.yaml"),
        ("report", "--help"),
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
_NOT_WHOLE = {
    "backends": set[str](),
    "backends.c_language": {"literals", "math_library"},
    "backends.c_lowering": {"options"},
    "backends.files": {"disk_arrays"},
    "backends.ports": {"identifiers"},
    "compiler.differentiation": {"estimated_starts", "sums_of_squares"},
    "compiler.interpreter": {"operations"},
    "compiler.jacobian": {"matrices"},
    "compiler.layers": set(),
    "compiler.layers.rules": {"fuzzy_sets", "layer_rule"},
    "compiler.passes": {
        "close_loop",
        "draw_dropout",
        "retime",
        "settle_zeros",
        "simplify",
        "to_step_form",
    },
    "compiler.passes.analyses": {
        "compact_sets",
        "infinite_slopes",
        "intervals",
        "kept_slices",
        "saturation",
    },
    "msnn.agreement": {"agreement", "judgement"},
    "msnn.data": {"dataset", "rollout_rows"},
    "msnn.data.formats": {"table_of_formats"},
    "msnn.data.reading": {"file_sets"},
    "msnn.exports": {"export", "prepare", "table", "target"},
    "msnn.exports.targets": {"c"},
    "msnn.model": {"load", "model", "model_files", "saved_run"},
    "msnn.model.weights": {"safetensors_file"},
    "msnn.project": {"package_names", "workflow_checks"},
    "msnn.reports": {"summary"},
    "msnn.simulation": {"rollout_plan"},
    "msnn.training": set(),
    "msnn.training.plans": {"epochs", "stage_checks", "stage_plan"},
    "msnn.training.ranks": {"training_ranks"},
    "msnn.validation": {"plan"},
}
"""Of rooms that mostly do other things, what `check` needs: above all what plans the sections."""
_MAY_BE_WHOLE = {
    "compiler",
    "compiler.builtins",
    "compiler.elaboration",
    "compiler.ir",
    "compiler.linking",
    "compiler.lowering",
    "msnn",
    "msnn.cli",
    "msnn.cli.verbs",
    "msnn.errors",
    "msnn.errors.data",
    "msnn.errors.learning",
    "msnn.errors.targets",
    "spec_schema",
    "spec_schema.diagnostics",
    "spec_schema.editors",
    "spec_schema.errors",
    "spec_schema.expressions",
    "spec_schema.fields",
    "spec_schema.reading",
    "spec_schema.sections",
    "spec_schema.units",
    "spec_schema.yaml_tree",
}


def test_check_imports_this_and_nothing_else(project: Path):
    said = in_new_process(("check", "plant.msnn.yaml"), project, start=_LISTED)
    assert said.code == 0, said.err
    loaded = set(said.err.splitlines())
    installed = packages_distributions()
    distributions = {name for module in loaded for name in installed.get(_top(module), ())}
    assert distributions - {"msnn"} == _DISTRIBUTIONS | _DISTRIBUTIONS_OF_THOSE
    packages = _MAY_BE_WHOLE | set(_NOT_WHOLE)
    ours = {module for module in loaded if _top(module) in {_top(name) for name in packages}}
    by_package = {package: set[str]() for package in packages}
    for module in ours - packages:
        package, _, name = module.rpartition(".")
        assert package in packages, module
        by_package[package].add(name)
    assert {package: by_package[package] for package in _NOT_WHOLE} == _NOT_WHOLE


def _top(module: str) -> str:
    return module.partition(".")[0]


_AT_ONCE = """
import sys
from dataclasses import dataclass
from msnn.cli.application import run
code = run(sys.argv[1:])
ours = ("backends", "compiler", "msnn", "spec_schema")
for name, module in sys.modules.items():
    if name.partition(".")[0] in ours and vars(module).get("dataclass") is dataclass:
        print(name, file=sys.stderr)
sys.exit(code)
"""


def test_dataclasses_that_check_loads_are_written_when_used(project: Path):
    said = in_new_process(("check", "plant.msnn.yaml"), project, start=_AT_ONCE)
    assert (said.code, said.err) == (0, "")


_COUNTED = """
import os, sys
leave = os._exit
def count_and_leave(code):
    print(len(os.listdir("/proc/self/task")), file=sys.stderr, flush=True)
    leave(code)
os._exit = count_and_leave
from msnn.cli.main import main
main()
"""


def test_rooms_of_what_a_spec_does_not_have_stay_closed(project: Path):
    said = in_new_process(("check", "plant.msnn.yaml"), project, start=_LISTED)
    loaded = set(said.err.splitlines())
    for closed in (
        "msnn.features.control.elaborate",  # `mpc` and `estimator`
        "compiler.elaboration.implicit_integration",  # `integrator: linear_implicit`
        "compiler.differentiation.reverse_mode",  # `grad`
        "compiler.layers.fir",
        "compiler.layers.local_model",
        "compiler.linking.renaming",  # `use`
        "msnn.features.control.keys",
        "spec_schema.sections.layer_kinds",
        "msnn.features.robots",
    ):
        assert not {name for name in loaded if f"{name}.".startswith(f"{closed}.")}


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="counts threads as Linux does")
def test_check_starts_no_threads(project: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    said = in_new_process(("check", "plant.msnn.yaml"), project, start=_COUNTED)
    assert (said.code, said.err) == (0, "1\n")  # that of Python itself


_COUNTED_AT_EXIT = """
import atexit, os, sys
def count():
    import numpy
    numpy.eye(500) @ numpy.eye(500)
    print("threads:", len(os.listdir("/proc/self/task")), file=sys.stderr, flush=True)
atexit.register(count)
from msnn.cli.main import main
main()
"""


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="counts threads as Linux does")
@pytest.mark.parametrize(("chosen", "threads"), [(None, 1), ("2", 2)])
def test_linear_algebra_has_one_thread_where_nobody_chose(
    chosen: str | None, threads: int, project: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    if chosen is not None:
        monkeypatch.setenv("OPENBLAS_NUM_THREADS", chosen)
    said = in_new_process(
        ("validate", "--initial", "plant.msnn.yaml"), project, start=_COUNTED_AT_EXIT
    )
    assert f"threads: {threads}\n" in said.err, said.err


_LOADED_AT_THE_END = """
import os, sys
leave = os._exit
def list_and_leave(code):
    print(*sys.modules, sep="\\n", file=sys.stderr, flush=True)
    leave(code)
os._exit = list_and_leave
from msnn.cli.main import main
main()
"""


@pytest.mark.parametrize("verb", ["check", "compile", "show"])
def test_what_looks_reads_no_metadata_of_distributions(project: Path, verb: str):
    said = in_new_process((verb, "plant.msnn.yaml"), project, start=_LOADED_AT_THE_END)
    assert said.code == 0, said.err
    loaded = said.err.split()
    assert "pydantic.main" in loaded
    assert "importlib.metadata" in loaded  # what stands for it
    assert not {"email", "importlib.metadata._adapters", "zipfile"} & set(loaded)


_ASKED_LATER = """
import sys
from msnn.project.imports import load_metadata_when_asked
load_metadata_when_asked()
from importlib.metadata import entry_points
import importlib.metadata
assert "email" not in sys.modules
ASK
assert "email" in sys.modules
from importlib.metadata import entry_points as own
assert own.__module__ == importlib.metadata.__name__ == "importlib.metadata"
assert importlib.metadata is sys.modules["importlib.metadata"]
assert importlib.metadata.entry_points is own
load_metadata_when_asked()
assert importlib.metadata.entry_points is own
"""


@pytest.mark.parametrize(
    "ask",
    [
        "assert list(entry_points(group='console_scripts'))",
        "assert importlib.metadata.version('numpy').split('.')",
        "from importlib.metadata import PackageNotFoundError as e; assert issubclass(e, Exception)",
        "import importlib.metadata._meta; importlib.metadata.files('numpy')",
        "import importlib.metadata as m; assert not hasattr(m, 'no_such') and m.Distribution",
    ],
)
def test_metadata_answer_whatever_they_are_asked(project: Path, ask: str):
    said = in_new_process((), project, start=_ASKED_LATER.replace("ASK", ask))
    assert (said.code, said.err) == (0, "")


def test_importing_msnn_imports_next_to_nothing(project: Path):
    start = (
        "import sys, msnn; print(*(m for m in ('numpy', 'pydantic', 'yaml') if m in sys.modules))"
    )
    said = in_new_process((), project, start=start)
    assert (said.code, said.out) == (0, "\n")
