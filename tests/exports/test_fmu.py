"""Functional Mock-up Units keep to FMI and compute the bits of the generated C."""

from __future__ import annotations

import resource
import zipfile
from collections.abc import Generator
from contextlib import ExitStack, contextmanager
from ctypes import byref
from dataclasses import replace
from pathlib import Path
from textwrap import dedent
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from numpy.typing import NDArray

from msnn.agreement.judgement import drawn_record
from msnn.errors.failures import MissingExtraError
from msnn.exports.check import check_export
from msnn.exports.export import load_export, plan_exports, target_named, write_export
from msnn.exports.running.loaded_fmu import FmuInstance, fmu_instance
from msnn.exports.target import AnyPlan, Written
from msnn.model.load import load_model
from msnn.model.weights.weights_file import initial_weights
from spec_schema.diagnostics.diagnostic import Findings
from tests.agreement.exported import checked
from tests.conditions import require_package, require_tool
from tests.examples.gallery import GALLERY, NAMES, spec_of

PLANT = """
msnn: 1
name: plant
doc: >-
  it's "<b>" & ]]> of ρ
sample_time: 0.1 s
dims: {wheel: [front, rear]}
inputs:
  torque: {unit: N*m, dims: wheel, range: [-3, 3], doc: "a < b, \\"quoted\\" ]]> %s \\n and on"}
  slope: {unit: deg, doc: "100 % of it"}
constants: {J: 2 kg*m^2, w0: 1 rad/s, T0: 100 degC}
parameters:
  k: {init: [2, 3], dims: wheel, unit: 1/s, min: 0, max: 9, doc: stiffness}
  T: {init: 21.5, unit: degC}
states:
  w: {dims: wheel, unit: rad/s, der: -k * w + torque / J, init: 0.25}
  m: {next: 0.5 * m + slope, init: m.meas, unit: deg, range: [-5, 5]}
outputs:
  w_next: {expr: next(w)}
  y: tanh(sum(w) / w0) + 0.1 * sin(slope[t-3]) * T / T0
  direct: slope * slope + m * slope
"""


@contextmanager
def units(written: Written) -> Generator[list[FmuInstance]]:
    """One instance of each version, not initialised."""
    with ExitStack() as stack:
        paths = sorted(path for path in written.files if path.suffix == ".fmu")
        yield [stack.enter_context(fmu_instance(path)) for path in paths]


def plan_of(spec: Path, target: str = "fmu", *settings: str) -> AnyPlan:
    (plan,) = plan_exports(load_model(spec, settings), [target], Findings())
    return plan


@pytest.fixture(scope="module")
def plant(tmp_path_factory: pytest.TempPathFactory) -> Path:
    spec = tmp_path_factory.mktemp("plant") / "plant.msnn.yaml"
    spec.write_text(dedent(PLANT), encoding="utf-8")
    return spec


@pytest.fixture(scope="module")
def exported(plant: Path) -> Written:
    require_tool("gcc", install="apt install gcc")
    require_package("fmpy", install="pip install 'msnn[fmu]'")
    plan = plan_of(plant)
    return write_export(plan, initial_weights(plan.program), plant.parent / "fmu")


def reference(unit: FmuInstance, name: str) -> int:
    """That of a variable, or of its first number."""
    variables = unit.description.modelVariables
    return next(v.valueReference for v in variables if v.name in (name, f"{name}[1]"))


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("name", NAMES)
def test_fmpy_finds_nothing_in_the_gallery(
    name: str, dtype: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    require_package("fmpy", install="pip install 'msnn[fmu]'")
    from fmpy.model_description import read_build_description
    from fmpy.validation import validate_fmu

    monkeypatch.setenv("CC", "no-such-compiler")  # descriptions are the same without a binary
    plan = plan_of(spec_of(GALLERY, name), "fmu", f"export.fmu.dtype={dtype}")
    written = write_export(plan, initial_weights(plan.program), tmp_path)
    second, third = sorted(path for path in written.files if path.suffix == ".fmu")
    assert validate_fmu(str(second)) == validate_fmu(str(third)) == []
    (build,) = read_build_description(str(third))
    assert build.modelIdentifier == plan.prefix
    # an importer compiles what is listed and nothing else
    lists = (
        (second, "modelDescription.xml", "File"),
        (third, "sources/buildDescription.xml", "SourceFile"),
    )
    for unit, place, tag in lists:
        with zipfile.ZipFile(unit) as archive:
            named = ElementTree.fromstring(archive.read(place)).iter(tag)  # noqa: S314
            there = {name for name in archive.namelist() if name.endswith(".c")}
        assert {f"sources/{each.attrib['name']}" for each in named} == there


def test_it_is_the_c_export_bit_for_bit(tmp_path: Path) -> None:
    require_tool("gcc", install="apt install gcc")
    require_package("fmpy", install="pip install 'msnn[fmu]'")
    found: list[Any] = []
    for target in ("c", "fmu"):
        plan = plan_of(spec_of(GALLERY, "two_tanks"), target)
        weights = initial_weights(plan.program)
        written = write_export(plan, weights, tmp_path / target)
        judged = plan.target.judge(plan, weights, drawn_record(plan.program, "drawn"), "float32")
        with load_export(plan, written) as loaded:
            found.append(loaded.run(judged.beginning, judged.inputs, judged.steps))
        sizes = [p.stat().st_size for p in written.files if p.suffix == ".fmu"]
        assert max(sizes, default=0) < 100_000
    assert {n: v.tobytes() for n, v in found[0].items()} == {
        n: v.tobytes() for n, v in found[1].items()
    }


def test_it_agrees_with_the_interpreter_step_by_step(plant: Path, tmp_path: Path) -> None:
    """In float64; `tests/agreement/test_compare.py` has the bits of float32."""
    require_tool("gcc", install="apt install gcc")
    require_package("fmpy", install="pip install 'msnn[fmu]'")
    plan = plan_of(plant, "fmu", "export.fmu.dtype=float64")
    found = checked(plan, initial_weights(plan.program), tmp_path)
    assert found.agrees, found
    assert found.one_step is not None


def test_text_stays_text(plant: Path, exported: Written) -> None:
    program = plan_of(plant).program
    with units(exported) as both:
        for unit in both:
            torque = next(
                v for v in unit.description.modelVariables if v.name in ("torque", "torque[1]")
            )
            assert torque.description.startswith('a < b, "quoted" ]]> %s and on')
            assert unit.description.description == program.doc == 'it\'s "<b>" & ]]> of ρ'


def test_the_description_says_units_ranges_and_starts(exported: Written) -> None:
    with units(exported) as both:
        second, third = (unit.description for unit in both)
        units_of = {unit.name: unit.baseUnit for unit in third.unitDefinitions}
        degrees = units_of["degC"]
        assert (degrees.K, degrees.factor, degrees.offset) == (1, 1.0, 273.15)
        assert units_of["deg"].rad == 1
        assert units_of["deg"].factor == np.pi / 180
        by_name = {v.name: v for v in third.modelVariables}
        k, torque = by_name["k"], by_name["torque"]
        assert (k.causality, k.variability, k.min, k.max, k.start) == (
            *("parameter", "tunable"),
            *("0", "9", "2 3"),
        )
        assert [d.start for d in k.dimensions] == [2] or [d.start for d in k.dimensions] == ["2"]
        assert (torque.unit, torque.min, torque.max) == ("N*m", "-3", "3")
        assert by_name["start.w"].start == "0.25 0.25"
        assert "start.m" in by_name
        names = {v.name: v for v in second.modelVariables}
        assert {"k[1]", "k[2]", "torque[2]", "start.slope[1]"} <= names.keys()
        assert names["torque[2]"].description.endswith("wheel rear")


def test_instances_do_not_share_anything(exported: Written) -> None:
    """Two interleaved ones, the second with parameters of its own, are as each alone."""

    def stepped(unit: FmuInstance, k: int) -> bytes:
        unit.set(reference(unit, "torque"), np.array([0.1 * k, -1.0]))
        unit.step(k, 0.1)
        return unit.get(reference(unit, "w_next"), (2,)).tobytes()

    def begun(unit: FmuInstance, stiffness: float) -> None:
        unit.initialise()
        unit.set(reference(unit, "k"), np.array([stiffness, 1.0]))
        unit.begin()

    for version in (0, 1):
        with units(exported) as one, units(exported) as other:
            a, b = one[version], other[version]
            alone: list[list[bytes]] = []
            for unit, stiffness in ((a, 2.0), (b, 5.0)):
                begun(unit, stiffness)
                alone.append([stepped(unit, k) for k in range(20)])
            begun(a, 2.0)
            begun(b, 5.0)
            both = [(stepped(a, k), stepped(b, k)) for k in range(20)]
            assert both == list(zip(*alone, strict=True))
            assert alone[0] != alone[1]


def test_a_saved_state_goes_on_bit_for_bit(exported: Written) -> None:
    def run(unit: FmuInstance, begin: int, end: int) -> list[bytes]:
        found: list[bytes] = []
        for k in range(begin, end):
            unit.set(reference(unit, "slope"), np.array(np.sin(k)))
            unit.step(k, 0.1)
            found.append(unit.get(reference(unit, "y"), ()).tobytes())
        return found

    with units(exported) as both, units(exported) as others:
        for unit, other in zip(both, others, strict=True):
            unit.initialise()
            unit.set(reference(unit, "start.w"), np.array([1.0, 2.0]))
            unit.begin()
            run(unit, 0, 10)
            state = unit.state
            continued = run(unit, 10, 30)
            unit.state = state
            assert run(unit, 10, 30) == continued
            other.initialise()
            other.begin()
            other.state = state
            assert run(other, 10, 30) == continued
            with pytest.raises(Exception, match=r"DeserializeFMUState|DeSerializeFMUstate"):
                unit.state = b"x" + state[1:]
            assert "no state of this unit" in unit.messages[-1]


def test_first_values_are_set_before_the_first_step_alone(exported: Written) -> None:
    with units(exported) as both:
        for unit in both:
            unit.initialise()
            unit.set(reference(unit, "start.w"), np.array([1.0, 2.0]))
            unit.set(reference(unit, "start.m"), np.array(3.0))
            assert unit.get(reference(unit, "w"), (2,)).tolist() == [1.0, 2.0]
            unit.begin()
            assert unit.get(reference(unit, "m"), ()) == 3.0
            with pytest.raises(Exception, match=r"Set(Real|Float32)"):
                unit.set(reference(unit, "start.m"), np.array(0.0))
            assert "before the first step" in unit.messages[-1]
            with pytest.raises(Exception, match=r"Set(Real|Float32)"):
                unit.set(reference(unit, "y"), np.array(0.0))
            assert "cannot be set" in unit.messages[-1]


def test_samples_that_nobody_sets_are_those_of_the_input(exported: Written) -> None:
    """A window of an input begins as if the input had always been what it is at the start."""
    with units(exported) as both:
        for unit in both:
            unit.initialise()
            unit.set(reference(unit, "slope"), np.array(0.5))
            unit.begin()
            samples = unit.description.modelVariables
            size = len([v for v in samples if v.name.startswith("start.slope[")]) or 3
            assert unit.get(reference(unit, "start.slope"), (size,)).tolist() == [0.5] * size


@pytest.mark.parametrize("seconds", [0.05, 0.15, 0.0, -0.1, float("nan"), 1e300])
def test_other_steps_than_multiples_are_refused(exported: Written, seconds: float) -> None:
    with units(exported) as both:
        for unit in both:
            unit.initialise()
            unit.begin()
            with pytest.raises(Exception, match="DoStep"):
                unit.step(0, seconds)
            assert unit.messages[-1] == "steps take whole multiples of the sample time, 0.1 s"


def test_a_multiple_is_as_many_steps(exported: Written) -> None:
    with units(exported) as both:
        for unit in both:
            found: list[bytes] = []
            for count, seconds in ((6, 0.1), (2, 0.3)):
                unit.initialise()
                unit.set(reference(unit, "torque"), np.array([1.0, 2.0]))
                unit.begin()
                for k in range(count):
                    unit.step(k, seconds)
                found.append(unit.get(reference(unit, "w"), (2,)).tobytes())
            assert found[0] == found[1]


def test_another_units_token_is_refused(exported: Written) -> None:
    with units(exported) as both:
        for unit in both:
            unit.description.guid = "{00000000-0000-0000-0000-000000000000}"
            with pytest.raises(Exception, match="Failed to instantiate"):
                FmuInstance(unit.description, unit._fmu.unzipDirectory)


def test_an_input_out_of_range_is_a_warning_once(exported: Written) -> None:
    with units(exported) as both:
        for unit in both:
            unit.initialise()
            unit.begin()
            unit.set(reference(unit, "torque"), np.array([7.0, 0.0]))
            for k in range(3):
                unit.step(k, 0.1)
            assert unit.messages == ["an input was outside its range and was used as it is"]


def test_what_the_start_finds_is_told_where_it_ends(exported: Written) -> None:
    with units(exported) as both:
        for unit in both:
            unit.initialise()
            unit.set(reference(unit, "torque"), np.array([7.0, 0.0]))
            assert unit.messages == []
            unit.begin()
            assert unit.messages == ["an input was outside its range and was used as it is"]


def test_a_reset_unit_is_as_it_was_made(exported: Written) -> None:
    with units(exported) as both:
        for unit in both:
            unit.initialise()
            made = unit.state
            for name, values in {
                "k": [5.0, 1.0],
                "torque": [1.0, 2.0],
                "start.w": [3.0, 4.0],
            }.items():
                unit.set(reference(unit, name), np.array(values))
            unit.begin()
            unit.step(0, 0.1)
            unit.initialise()
            assert unit.get(reference(unit, "k"), (2,)).tolist() == [2.0, 3.0]
            unit.initialise()
            assert unit.state == made


def test_arrays_are_set_and_read_whole(exported: Written) -> None:
    """FMI 3.0 passes how many values there are: none is written or read beyond them."""
    with units(exported) as (_, unit):
        unit.initialise()
        torque = reference(unit, "torque")
        unit.set(torque, np.array([1.0, 2.0]))
        for values, why in (([3.0], "fewer"), ([3.0, 4.0, 5.0], "more")):
            with pytest.raises(Exception, match="SetFloat32"):
                unit._fmu.setFloat32([torque], values)
            said = f"there are {why} values than these variables have"
            assert unit.messages[-1] == said
            with pytest.raises(Exception, match="GetFloat32"):
                unit._fmu.getFloat32([torque], len(values))
            assert unit.messages[-1] == said


def test_a_step_says_how_far_it_came(exported: Written) -> None:
    with units(exported) as (_, unit):
        unit.initialise()
        unit.begin()
        *_, came = unit._fmu.doStep(0.2, 0.1)
        assert came == pytest.approx(0.3)
        assert unit._fmu.getFloat64([reference(unit, "time")], 1) == [came]


def test_time_begins_where_the_importer_says(exported: Written) -> None:
    with units(exported) as (_, unit):
        unit.initialise()
        unit._fmu.reset()
        unit._fmu.enterInitializationMode(startTime=2.5)
        time = reference(unit, "time")
        assert unit._fmu.getFloat64([time], 1) == [2.5]
        unit.begin()
        assert unit._fmu.getFloat64([time], 1) == [2.5]
        unit.step(25, 0.1)
        assert unit._fmu.getFloat64([time], 1) == [pytest.approx(2.6)]


def test_it_is_for_co_simulation_only(exported: Written) -> None:
    from fmpy.fmi2 import fmi2ModelExchange
    from fmpy.fmi3 import FMU3Model

    with units(exported) as (second, third):
        token = second.description.guid.encode()
        make, callbacks = second._fmu.fmi2Instantiate, byref(second._callbacks)
        assert not make(b"msnn", fmi2ModelExchange, token, b"", callbacks, 0, 0)
        assert second.messages == ["this unit is for co-simulation only"]
        other = FMU3Model(
            guid=third.description.guid,
            modelIdentifier="plant",
            unzipDirectory=third._fmu.unzipDirectory,
            instanceName="msnn",
        )
        with pytest.raises(Exception, match="Failed to instantiate"):
            other.instantiate()


def test_slopes_are_those_of_finite_differences(exported: Written) -> None:
    """Central ones of the step that follows; float32 leaves them four digits, of numbers near 1."""
    change = 2.0**-7
    outputs = {"w_next": 2, "y": 1, "direct": 1}
    with units(exported) as both:
        for unit in both:
            unit.initialise()
            unit.begin()
            start = {"torque": np.array([0.5, -1.0]), "slope": np.array([0.7])}
            for name, values in start.items():
                unit.set(reference(unit, name), values)
            unit.step(0, 0.1)
            state = unit.state
            for name, values in start.items():
                for element in range(len(values)):
                    ends: list[NDArray[np.float64]] = []
                    for sign in (1.0, -1.0):
                        unit.state = state
                        moved = values.copy()
                        moved[element] += sign * change
                        unit.set(reference(unit, name), moved)
                        unit.step(1, 0.1)
                        found = [unit.get(reference(unit, n), (s,)) for n, s in outputs.items()]
                        ends.append(np.concatenate(found).astype(float))
                    unit.state = state
                    unit.set(reference(unit, name), values)
                    slopes = unit.slopes(
                        {reference(unit, n): s for n, s in outputs.items()},
                        {reference(unit, name): np.eye(len(values))[element]},
                    )
                    expected = (ends[0] - ends[1]) / (2.0 * change)
                    assert np.allclose(slopes, expected, rtol=1e-3, atol=1e-4), (name, element)
                    assert np.any(slopes)
            rows = {reference(unit, n): s for n, s in outputs.items()}
            each = [unit.slopes(rows, {reference(unit, "torque"): seed}) for seed in np.eye(2)]
            both_at_once = unit.slopes(rows, {reference(unit, "torque"): np.array([0.5, -2.0])})
            assert np.array_equal(both_at_once, 0.5 * each[0] - 2.0 * each[1])
            with pytest.raises(Exception, match="DirectionalDerivative"):
                unit.slopes({reference(unit, "slope"): 1}, {reference(unit, "y"): np.ones(1)})
            assert unit.messages[-1] == "there are slopes of outputs in inputs, and no others"


def test_an_input_that_states_alone_read_has_slope_0(tmp_path: Path) -> None:
    spec = tmp_path / "held.msnn.yaml"
    text = """
    msnn: 1
    name: held
    sample_time: 0.1 s
    inputs: {u: {}, v: {}}
    states: {x: {next: v, init: 0}}
    outputs: {y: 3 * u + x}
    """
    spec.write_text(dedent(text), encoding="utf-8")
    plan = plan_of(spec)
    written = write_export(plan, initial_weights(plan.program), tmp_path)
    with units(written) as both:
        for unit in both:
            unit.initialise()
            unit.begin()
            for name, slope in {"u": 3.0, "v": 0.0}.items():
                found = unit.slopes({reference(unit, "y"): 1}, {reference(unit, name): np.ones(1)})
                assert np.array_equal(found, [slope])


def test_a_million_steps_leave_memory_where_it_was(exported: Written) -> None:
    with units(exported) as both:
        for unit in both:
            unit.initialise()
            unit.begin()
            unit.step(0, 100.0)
            before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
            for k in range(100):
                unit.step(k, 1000.0)
            assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 1024  # KiB


def test_the_archive_is_the_same_but_for_the_binary(
    exported: Written, plant: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CC", "no-such-compiler")
    plan = plan_of(plant)
    again = write_export(plan, initial_weights(plan.program), tmp_path)
    for one, other in zip(exported.files, again.files, strict=True):
        if one.suffix != ".fmu":
            assert one.read_bytes() == other.read_bytes()
            continue
        with zipfile.ZipFile(one) as a, zipfile.ZipFile(other) as b:
            named = [name for name in a.namelist() if not name.startswith("binaries/")]
            assert named == b.namelist()
            assert all(a.read(name) == b.read(name) for name in named)
            assert {a.getinfo(name).date_time for name in a.namelist()} == {(1980, 1, 1, 0, 0, 0)}


def test_other_weights_are_another_unit(
    plant: Path, exported: Written, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CC", "no-such-compiler")
    plan = plan_of(plant)
    weights = initial_weights(plan.program)
    others = write_export(plan, {**weights, "k": weights["k"] + 1}, tmp_path)

    def tokens(written: Written) -> list[str]:
        found: list[str] = []
        for path in sorted(p for p in written.files if p.suffix == ".fmu"):
            with zipfile.ZipFile(path) as archive:
                root = ElementTree.fromstring(archive.read("modelDescription.xml"))  # noqa: S314
            found.append(root.get("guid") or root.get("instantiationToken") or "")
        return found

    assert not set(tokens(exported)) & set(tokens(others))


def test_without_a_compiler_there_are_the_sources(
    plant: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    require_package("fmpy", install="pip install 'msnn[fmu]'")
    monkeypatch.setenv("CC", "no-such-compiler")
    plan = plan_of(plant)
    weights = initial_weights(plan.program)
    written = write_export(plan, weights, tmp_path)
    with zipfile.ZipFile(tmp_path / "plant_fmi3.fmu") as archive:
        names = archive.namelist()
    assert "sources/plant_fmi3.c" in names
    assert not [name for name in names if name.startswith("binaries/")]
    assert "no C compiler" in target_named("fmu").tell(replace(plan), tmp_path)
    with pytest.raises(MissingExtraError):
        check_export(plan, weights, written, drawn_record(plan.program, "drawn"))
