"""Units of controllers and estimators keep to FMI and compute the bits of their C."""

from __future__ import annotations

import itertools
import resource
import subprocess
import zipfile
from collections.abc import Generator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np
import pytest

from backends.fmu.binary import HEADERS
from msnn.agreement.judgement import drawn_record
from msnn.exports.check import check_export
from msnn.exports.export import plan_exports, write_export
from msnn.exports.running.loaded_fmu import FmuInstance, fmu_instance
from msnn.exports.target import AnyPlan, Written
from msnn.model.load import load_model
from msnn.model.weights.weights_file import initial_weights
from spec_schema.diagnostics.diagnostic import Findings
from tests.conditions import require_package, require_tool
from tests.features.control.backend.test_filters import SPECS as FILTERS
from tests.features.control.backend.test_moving_horizons import SPECS as WINDOWS
from tests.features.control.gallery_problems import PROBLEMS
from tests.features.control.specs import DELAYED

HEATED = """
msnn: 1
name: heated
doc: 'a "<b>" & ]]> of ρ'
sample_time: 2 s
inputs:
  heat: {unit: W, range: [0, 100], between: hold, doc: "a < b %s"}
  outside: {unit: degC, range: [-20, 40]}
constants: {W: 1 W, K: 1 K, c: 2000 J/K, air: 10 degC}
parameters: {g: {init: 3, unit: W/K}}
states:
  room: {unit: degC, der: "(heat - g * (room - outside)) / c", init: room.meas, range: [-50, 90]}
outputs: {seen: {expr: room, predicts: "room[t]"}}
mpc:
  horizon: 8
  controls: [heat]
  references: {wanted: {unit: degC, preview: true}}
  cost: ((room - wanted) / K)**2 + 1e-4 * (heat / W)**2
  bounds: {heat: {min: 5, max: 60, rate: 4 W/s}}
estimator:
  ekf: {measured: {seen: 0.2 K}, process: {room: 0.05}, initial: {room: 1}}
"""
_PLANT, _, _SECTIONS = HEATED.partition("mpc:\n")
WINDOW = _PLANT + _SECTIONS[_SECTIONS.index("estimator:") :].replace("ekf: {", "mhe: {horizon: 4, ")
SPECS = {
    "heated": HEATED,
    "delayed": DELAYED,
    **FILTERS,
    "window": WINDOW,
    "delayed_window": WINDOWS["delayed"],
    "vectors_window": WINDOWS["vectors"],
}


def plan_of(text: str, folder: Path, dtype: str = "float64") -> AnyPlan:
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "spec.msnn.yaml"
    path.write_text(text, encoding="utf-8")
    model = load_model(path, [f"export.mpc.dtype={dtype}", "export.mpc.with=fmu"])
    (plan,) = plan_exports(model, ["mpc"], Findings())
    return plan


def written(plan: AnyPlan, folder: Path) -> Written:
    return write_export(plan, initial_weights(plan.program), folder)


def archives(files: Written) -> list[Path]:
    return sorted(path for path in files.files if path.suffix == ".fmu")


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> Written:
    require_tool("gcc", install="apt install gcc")
    require_package("fmpy", install="pip install 'msnn[fmu]'")
    folder = tmp_path_factory.mktemp("heated")
    return written(plan_of(HEATED, folder), folder / "out")


@pytest.fixture(scope="module")
def window(tmp_path_factory: pytest.TempPathFactory) -> Written:
    require_tool("gcc", install="apt install gcc")
    require_package("fmpy", install="pip install 'msnn[fmu]'")
    folder = tmp_path_factory.mktemp("window")
    return written(plan_of(WINDOW, folder), folder / "out")


@pytest.fixture(params=["ekf", "mhe"])
def estimators(request: pytest.FixtureRequest, exported: Written, window: Written) -> list[Path]:
    """The units of a filter, and those of a window, of one plant."""
    return own_units(exported if request.param == "ekf" else window, request.param)


def own_units(files: Written, kind: str) -> list[Path]:
    return [path for path in archives(files) if f"_{kind}_" in path.name]


@contextmanager
def instances(paths: list[Path]) -> Generator[list[FmuInstance]]:
    """One of each, not initialised."""
    with ExitStack() as stack:
        yield [stack.enter_context(fmu_instance(path)) for path in paths]


@contextmanager
def units(files: Written, kind: str) -> Generator[list[FmuInstance]]:
    """One instance of each version, not initialised."""
    with instances(own_units(files, kind)) as both:
        yield both


def reference(unit: FmuInstance, name: str) -> int:
    variables = unit.description.modelVariables
    return next(v.valueReference for v in variables if v.name in (name, f"{name}[1]"))


def solved(unit: FmuInstance, number: int, room: float) -> tuple[bytes, int, int]:
    """Control, status and iterations of a step."""
    unit.set(reference(unit, "room"), np.array(room))
    unit.set(reference(unit, "wanted"), np.full(9, 21.0))
    unit.step(number, 2.0)
    return (
        unit.get(reference(unit, "heat"), ()).tobytes(),
        unit.count(reference(unit, "status")),
        unit.count(reference(unit, "iterations")),
    )


@pytest.mark.parametrize(
    ("name", "dtype"),
    list(zip([*PROBLEMS, *SPECS], itertools.cycle(("float32", "float64")), strict=False)),
)
def test_fmpy_finds_nothing(
    name: str, dtype: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    require_package("fmpy", install="pip install 'msnn[fmu]'")
    from fmpy.validation import validate_fmu

    monkeypatch.setenv("CC", "no-such-compiler")  # descriptions are the same without a binary
    text = SPECS.get(name)
    if text is None:
        PROBLEMS[name].model(name, tmp_path)
        text = (tmp_path / f"{name}.msnn.yaml").read_text(encoding="utf-8")
    files = written(plan_of(text, tmp_path, dtype), tmp_path / "out")
    found = archives(files)
    assert len(found) in (2, 4)
    assert {path.name: validate_fmu(str(path)) for path in found} == {p.name: [] for p in found}


def test_other_bits_are_told(tmp_path: Path) -> None:
    """The unit of other weights is not that of the C beside it."""
    require_tool("gcc", install="apt install gcc")
    require_package("fmpy", install="pip install 'msnn[fmu]'")
    plan = plan_of(HEATED, tmp_path)
    weights = initial_weights(plan.program)
    files = written(plan, tmp_path / "out")
    record = drawn_record(plan.program, "drawn")
    # as users have them; those of the other specs are compared without an optimiser
    own = check_export(plan, weights, files, record)
    assert (own.bits, own.agrees) == (0, True), own
    others = write_export(plan, {**weights, "g": weights["g"] * 1.5}, tmp_path / "others")
    for one, other in zip(archives(files), archives(others), strict=True):
        one.write_bytes(other.read_bytes())
    found = check_export(plan, weights, files, record)
    assert {fault.of for fault in found.faults} == {
        "the unit of FMI 2.0",
        "the unit of FMI 3.0",
    }


def test_the_description_says_units_ranges_and_docs(exported: Written) -> None:
    with units(exported, "mpc") as both:
        second, third = ({v.name: v for v in u.description.modelVariables} for u in both)
        heat = third["heat"]
        assert (heat.causality, heat.unit, heat.min, heat.max) == ("output", "W", "5", "60")
        assert heat.description == "a < b %s; of this sample, inside its limits"
        assert second["wanted[3]"].description.endswith("t+2")
        assert third["start.heat"].start == "5"
        assert third["outside"].min == "-20"
        assert third["iterations"].type == "UInt32"
        assert second["iterations"].type == "Integer"
        assert "2: no plan keeps all limits" in third["status"].description
        assert both[1].description.description == 'a "<b>" & ]]> of ρ'
    with units(exported, "ekf") as both:
        for unit in both:
            names = {v.name for v in unit.description.modelVariables}
            assert {"heat", "measured.room", "room", "std.room", "innovation.room"} <= names


def test_samples_of_memory_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    require_package("fmpy", install="pip install 'msnn[fmu]'")
    from fmpy import read_model_description

    monkeypatch.setenv("CC", "no-such-compiler")
    for path in archives(written(plan_of(DELAYED, tmp_path), tmp_path / "out")):
        if path.name.endswith("fmi2.fmu"):  # FMI 3.0 has arrays, whose elements have no text
            known = {
                v.name: v.description or ""
                for v in read_model_description(str(path)).modelVariables
            }
            ends = [known[name].rpartition(" ")[2] for name in ("u.history[1]", "u.history[2]")]
            assert ends == ["t-2", "t-1"]
            assert known["d.history[1]"].endswith(" t-1")


def test_a_controller_begins_at_the_control_that_is_applied(exported: Written) -> None:
    """From 40 W a rate of 8 W a sample leads to 48 W at most; 5 W is where nothing was said."""
    with units(exported, "mpc") as both:
        for unit in both:
            unit.initialise()
            unit.set(reference(unit, "start.heat"), np.array(40.0))
            unit.set(reference(unit, "heat.history"), np.array([40.0]))
            unit.set(reference(unit, "room"), np.array(0.0))
            unit.set(reference(unit, "wanted"), np.full(9, 21.0))
            assert unit.get(reference(unit, "heat"), ()) == pytest.approx(48.0)
            unit.begin()
            solved(unit, 0, 0.0)
            assert unit.get(reference(unit, "heat"), ()) == pytest.approx(48.0)
            with pytest.raises(Exception, match=r"SetReal|SetFloat64"):
                unit.set(reference(unit, "start.heat"), np.array(0.0))


def test_what_cannot_be_solved_is_a_warning(exported: Written) -> None:
    with units(exported, "mpc") as both:
        for unit in both:
            unit.initialise()
            unit.begin()
            before, *_ = solved(unit, 0, 20.0)
            assert solved(unit, 1, float("nan"))[:2] == (before, 3)
            solved(unit, 2, float("nan"))
            assert unit.messages == [
                "an input is infinite or NaN, or a limit NaN: the last controls"
            ]
            with pytest.raises(Exception, match="DoStep"):
                unit.step(3, 3.0)
            assert unit.messages[-1] == "steps take whole multiples of the sample time, 2 s"


def test_controllers_share_nothing_and_go_on_from_a_saved_state(exported: Written) -> None:
    with units(exported, "mpc") as both, units(exported, "mpc") as others:
        for one, other in zip(both, others, strict=True):
            rooms = [10.0 + k for k in range(8)]
            alone: list[list[tuple[bytes, int, int]]] = []
            for unit, off in ((one, 0.0), (other, 5.0)):
                unit.initialise()
                unit.begin()
                alone.append([solved(unit, k, room + off) for k, room in enumerate(rooms)])
            for unit in (one, other):
                unit.initialise()
                unit.begin()
            together = [
                (solved(one, k, room), solved(other, k, room + 5.0)) for k, room in enumerate(rooms)
            ]
            assert together == list(zip(*alone, strict=True))
            state = one.state
            continued = [solved(one, k, 19.0 + k) for k in range(4)]
            other.state = state
            assert [solved(other, k, 19.0 + k) for k in range(4)] == continued


def filtered(unit: FmuInstance, number: int, seen: float) -> tuple[bytes, bytes]:
    """Estimate and deviation of a step."""
    unit.set(reference(unit, "heat"), np.array(30.0))
    unit.set(reference(unit, "measured.room"), np.array(seen))
    unit.step(number, 2.0)
    room, std = (unit.get(reference(unit, name), ()) for name in ("room", "std.room"))
    return room.tobytes(), std.tobytes()


def test_estimators_share_nothing_and_go_on_from_a_saved_state(estimators: list[Path]) -> None:
    with instances(estimators) as both, instances(estimators) as others:
        for one, other in zip(both, others, strict=True):

            def begun(unit: FmuInstance, room: float) -> None:
                unit.initialise()
                unit.set(reference(unit, "start.room"), np.array(room))
                unit.begin()

            alone: list[list[tuple[bytes, bytes]]] = []
            for unit, room in ((one, 15.0), (other, 18.0)):
                begun(unit, room)
                alone.append([filtered(unit, k, room + 0.1 * k) for k in range(8)])
            begun(one, 15.0)
            begun(other, 18.0)
            together = [
                (filtered(one, k, 15.0 + 0.1 * k), filtered(other, k, 18.0 + 0.1 * k))
                for k in range(8)
            ]
            assert together == list(zip(*alone, strict=True))
            assert alone[0] != alone[1]
            state = one.state
            continued = [filtered(one, k, 16.0) for k in range(4)]
            other.state = state
            assert [filtered(other, k, 16.0) for k in range(4)] == continued


def test_an_unmeasured_sample_leaves_the_prediction(estimators: list[Path]) -> None:
    """NaN is no measurement: the deviation grows, the estimate is that of the model."""
    with instances(estimators) as both:
        for unit in both:
            unit.initialise()
            unit.set(reference(unit, "start.room"), np.array(15.0))
            unit.begin()
            found: list[tuple[float, float]] = []
            for k, seen in enumerate((15.1, float("nan"), float("nan"))):
                unit.set(reference(unit, "heat"), np.array(30.0))
                unit.set(reference(unit, "outside"), np.array(5.0))
                unit.set(reference(unit, "measured.room"), np.array(seen))
                unit.step(k, 2.0)
                assert unit.count(reference(unit, "status")) == 0
                found.append(
                    (
                        float(unit.get(reference(unit, "room"), ())),
                        float(unit.get(reference(unit, "std.room"), ())),
                    )
                )
            (first, narrow), (second, wider), _ = found
            assert second == pytest.approx(first + 2.0 * (30.0 - 3.0 * (first - 5.0)) / 2000.0)
            assert wider > narrow


def test_a_window_says_how_it_was_solved(window: Written) -> None:
    """Statuses are those of its C; only what leaves the window aside is a warning."""
    with units(window, "mhe") as both:
        for unit in both:
            unit.initialise()
            unit.set(reference(unit, "start.room"), np.array(15.0))
            unit.begin()
            filtered(unit, 0, 15.1)
            assert unit.count(reference(unit, "iterations")) >= 1
            assert unit.get(reference(unit, "residual"), ()) <= 1e-6
            filtered(unit, 1, float("inf"))
            filtered(unit, 2, float("inf"))
            assert unit.count(reference(unit, "status")) == 3
            assert unit.messages == ["an input is infinite or NaN: the estimate is as it was"]
            filtered(unit, 3, 15.2)
            assert unit.count(reference(unit, "status")) == 0


def test_a_register_that_nobody_sets_holds_what_the_input_is(tmp_path: Path) -> None:
    require_tool("gcc", install="apt install gcc")
    require_package("fmpy", install="pip install 'msnn[fmu]'")
    files = written(plan_of(DELAYED, tmp_path), tmp_path / "out")
    with units(files, "ekf") as both:
        for unit in both:
            unit.initialise()
            unit.set(reference(unit, "u"), np.array(0.5))
            unit.set(reference(unit, "start.y.tape"), np.zeros(3))
            unit.begin()
            unit.set(reference(unit, "measured.y"), np.array(0.0))
            unit.step(0, 1.0)
            assert unit.count(reference(unit, "status")) == 0
            assert unit.get(reference(unit, "u.history"), (2,)).tolist() == [0.5, 0.5]


def test_solves_leave_memory_where_it_was(exported: Written) -> None:
    """Ten thousand; `benchmarks/fmu/gallery.py` takes a million."""
    with units(exported, "mpc") as both:
        for unit in both:
            unit.initialise()
            unit.begin()
            solved(unit, 0, 10.0)
            before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
            unit.step(1, 2e4)
            assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 1024  # KiB


def test_steps_leave_memory_where_it_was(estimators: list[Path]) -> None:
    """A million of a filter; a window, which solves at each, ten thousand."""
    seconds = 2e6 if "_ekf_" in estimators[0].name else 2e4
    with instances(estimators) as both:
        for unit in both:
            unit.initialise()
            unit.set(reference(unit, "start.room"), np.array(15.0))
            unit.begin()
            unit.step(0, 2000.0)
            before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
            unit.step(1, seconds)
            assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 1024  # KiB


def test_sources_compile_without_warnings(tmp_path: Path) -> None:
    require_tool("gcc", install="apt install gcc")
    strict = ["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror", "-O2"]
    compiled: set[bytes] = set()
    for name, dtype in (("heated", "float32"), ("delayed", "float64"), ("vectors", "float32")):
        files = written(plan_of(SPECS[name], tmp_path / name, dtype), tmp_path / name / "out")
        for path in archives(files):
            place = tmp_path / path.stem
            with zipfile.ZipFile(path) as archive:
                archive.extractall(place)
            for source in sorted((place / "sources").glob("*.c")):
                # of the units for the two versions of FMI, only one source differs
                if source.read_bytes() not in compiled:
                    include = [f"-I{HEADERS}", f"-I{source.parent}"]
                    command = ["gcc", *strict, *include, "-c", source, "-o", "/dev/null"]
                    subprocess.run(command, check=True)
                compiled.add(source.read_bytes())


def test_the_archives_are_the_same_but_for_the_binary(
    exported: Written, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CC", "no-such-compiler")
    again = written(plan_of(HEATED, tmp_path), tmp_path / "out")
    for one, other in zip(archives(exported), archives(again), strict=True):
        with zipfile.ZipFile(one) as a, zipfile.ZipFile(other) as b:
            named = [name for name in a.namelist() if not name.startswith("binaries/")]
            assert named == b.namelist()
            assert all(a.read(name) == b.read(name) for name in named)
