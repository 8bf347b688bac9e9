"""Program files: the same program back, the same bytes, one clear answer to any other file."""

from __future__ import annotations

import copy
import json
import math
import random
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import pytest

from compiler.ir.builder import GraphBuilder
from compiler.ir.program import (
    Dimension,
    Expected,
    Fit,
    Graph,
    LayerMemory,
    Loss,
    Measure,
    Output,
    Parameter,
    Program,
    Role,
    Signal,
    State,
    Statistic,
)
from compiler.ir.text import program_text
from compiler.ir.types import Axis, Prediction, Type
from compiler.passes.close_loop import close_loop
from compiler.passes.to_step_form import to_step_form
from compiler.program_file.file import (
    program_from_data,
    program_from_json,
    program_to_data,
    program_to_json,
    read_program,
)
from spec_schema.diagnostics.diagnostic import SpecError, describe
from spec_schema.diagnostics.source import Span
from spec_schema.units.parser import parse_unit
from tests.every_op.record import Record
from tests.every_op.records import RECORDS
from tests.golden import assert_golden
from tests.pass_programs import PASS_PROGRAMS
from tests.programs import SAMPLES

PROGRAMS: dict[str, Callable[[], Program]] = {
    **{name: lambda make=make: make().program for name, make in SAMPLES.items()},
    **{
        f"{name} in step form": lambda make=make: to_step_form(
            close_loop(make().program, make().closed)
        )
        for name, make in SAMPLES.items()
    },
    **PASS_PROGRAMS,
}


@pytest.mark.parametrize("name", PROGRAMS)
def test_program_comes_back_from_its_file(name: str) -> None:
    program = PROGRAMS[name]()
    text = program_to_json(program)
    read = program_from_json(text, "model.json")
    assert read == program
    assert program_text(read) == program_text(program)  # with places and labels
    assert program_to_json(read) == text
    assert program_from_data(json.loads(json.dumps(program_to_data(program))), "x") == program


@pytest.mark.parametrize("record", RECORDS, ids=lambda record: record.name)
def test_every_operation_comes_back_from_its_file(record: Record) -> None:
    assert program_from_json(program_to_json(record.program), "model.json") == record.program


def test_every_declaration_comes_back_with_all_it_can_say() -> None:
    """No value is its default, so that a field which is forgotten shows."""
    span, axes, unit = (
        Span(file="a.msnn.yaml", line=3, column=1, end_line=3, end_column=9),
        (Axis("k", 2),),
        parse_unit("N*m"),
    )
    b, starts = GraphBuilder(), GraphBuilder()
    x = b.signal("x", 0, 0, Type(axes, unit))
    total = b.sum(x, "k")
    first = starts.parameter("p", Type(axes, unit))
    program = Program(
        name="all",
        sample_time=0.5,
        signals=(
            Signal("x", Role.INPUT, axes, unit, (-1.0, 2.0), "hold", "doc", span),
            Signal("y", Role.TARGET),
        ),
        parameters=(
            Parameter(
                name="p",
                axes=axes,
                unit=unit,
                initial=(0.5, 1.0),
                minimum=0.0,
                maximum=2.0,
                scale=3.0,
                learn=False,
                statistic=Statistic("std", "x"),
                doc="doc",
                span=span,
            ),
        ),
        states=(
            State(
                name="s",
                axes=axes,
                unit=unit,
                origin=LayerMemory(starts_fresh_each_run=True),
                next=x,
                start=first,
                range=(-math.inf, 1.0),
                doc="doc",
                span=span,
                on_range="reset",
                needs=("part",),
            ),
        ),
        step=b.graph(),
        start=starts.graph(),
        outputs=(Output("out", total, Prediction("y", 2), "doc", span, ("part",)),),
        losses=(Loss("l.huber", Measure.HUBER, total, total, 2.0, 0.25, span=span, delta=0.5),),
        expected=(Expected("e", total, (0.0, math.inf), span),),
        fits=(
            Fit(
                kind="iir",
                layer="f",
                argument=b.graph(),
                target=Prediction("y", 2),
                num=1,
                den=2,
                feedthrough=True,
                radius=0.9,
            ),
        ),
        dimensions=(Dimension("k", 2, ("a", "b")),),
        doc="doc",
        spec_hash="ab",
    )
    data = json.loads(json.dumps(program_to_data(program)))
    assert read_program(data) == program


def test_text_of_a_file(accept: bool) -> None:
    text = program_to_json(PROGRAMS["fir_closed_loop in step form"]())
    folder = Path(__file__).parent.parent / "golden" / "program_file"
    assert_golden(folder / "fir_closed_loop.json", text, accept)


def test_numbers_keep_every_bit() -> None:
    numbers = (0.1, -0.0, 5e-324, 1.7976931348623157e308, 1 / 3)
    b = GraphBuilder()
    outputs = tuple(Output(f"y{i}", b.constant(value)) for i, value in enumerate(numbers))
    program = Program("numbers", None, (), (), (), b.graph(), Graph(), outputs)
    read = program_from_json(program_to_json(program), "x")
    assert repr([node.op for node in read.step.nodes]) == repr([n.op for n in b.graph().nodes])


def test_infinite_bounds_and_roots_of_units_come_back() -> None:
    b = GraphBuilder()
    root = parse_unit("m").power(Fraction(1, 2))
    x = b.signal("x", 0, 0, Type((), root))
    signal = Signal("x", Role.INPUT, (), root, range=(0.0, float("inf")), on_invalid="hold")
    program = Program("roots", None, (signal,), (), (), b.graph(), Graph(), (Output("y", x),))
    assert program_from_json(program_to_json(program), "x") == program


def test_two_specs_of_one_name_stay_two() -> None:
    b = GraphBuilder()
    places = [
        Span(file=f"/somewhere/{folder}/part.msnn.yaml", line=3, column=1, end_line=3, end_column=9)
        for folder in ("a", "b")
    ]
    for number, place in enumerate(places):
        with b.at(place):
            b.signal(f"x{number}", 0, 0, Type())
    program = Program("two", None, (), (), (), b.graph(), Graph(), ())
    found = read_program(json.loads(json.dumps(program_to_data(program)))).step.nodes
    assert [n.span.file for n in found if n.span] == ["a/part.msnn.yaml", "b/part.msnn.yaml"]


def test_places_name_the_file_without_its_folder() -> None:
    b = GraphBuilder()
    with b.at(
        Span(file="/home/someone/secret/a.msnn.yaml", line=3, column=1, end_line=3, end_column=9)
    ):
        x = b.signal("x", 0, 0, Type())
    signals = (Signal("x", Role.INPUT),)
    program = Program("places", None, signals, (), (), b.graph(), Graph(), (Output("y", x),))
    text = program_to_json(program)
    assert "secret" not in text
    assert program_from_json(text, "x").step[x].span == Span(
        file="a.msnn.yaml", line=3, column=1, end_line=3, end_column=9
    )


def _failure(text: str) -> str:
    with pytest.raises(SpecError) as raised:
        program_from_json(text, "model.json")
    (diagnostic,) = raised.value.diagnostics
    assert diagnostic.help
    return describe(diagnostic)


GOOD = program_to_data(PROGRAMS["spring_damper_rk4"]())


def _changed(change: Callable[[dict[str, Any]], object]) -> str:
    data = copy.deepcopy(GOOD)
    change(data)
    return json.dumps(data)


E1050 = "error[E1050]: model.json is not a program file: "
E1052 = "error[E1052]: model.json holds no legal program: "
_OPERATIONS = (
    "Constant, ReadParameter, ReadSignal, ReadLog, ReadState, Add, Subtract, Multiply, Divide,"
    " Negate, Minimum, Maximum, Clamp, Compare, Select, Apply, Dropout, Named, Broadcast, Reshape,"
    " Slice, Concat, Sum, Contract, Window"
)
BAD: dict[str, tuple[str, str]] = {
    "no json": ("{", E1050 + "it is not JSON"),
    "a yaml spec": ("name: msd\ninputs: {}\n", E1050 + "it is not JSON"),
    "empty": ("", E1050 + "it is not JSON"),
    "too deep": ("[" * 100_000, E1050 + "it is nested too deep"),
    "not a number": (
        _changed(lambda d: d["parameters"][0].update(initial=[float("nan")])),
        E1050 + "it is not JSON",
    ),
    "long integer": ('{"format": ' + "1" * 10_000 + "}", E1050 + "it is not JSON"),
    "large integer": ('{"format": 1e400}', E1050 + "the file.format is no whole number"),
    "list": ("[]", E1050 + "the file is no object"),
    "no format": ("{}", E1050 + "the file has no 'format'"),
    "newer": (
        _changed(lambda d: d.update(format=2)),
        "error[E1051]: model.json has format 2; this version reads format 1",
    ),
    "missing key": (_changed(lambda d: d.pop("step")), E1050 + "the file has no 'step'"),
    "unknown key": (
        _changed(lambda d: d["step"][0].update(evil=1)),
        E1050 + "the file.step[0] has the unknown key 'evil'",
    ),
    "unknown op": (
        _changed(lambda d: d["step"][0].update(op="__import__")),
        E1050 + f"the file.step[0]: '__import__' is none of {_OPERATIONS}",
    ),
    "op that only graphs of training have": (
        _changed(lambda d: d["step"][0].update(op="ReadTraining")),
        E1050 + f"the file.step[0]: 'ReadTraining' is none of {_OPERATIONS}",
    ),
    "text for a number": (
        _changed(lambda d: d["parameters"][0].update(initial=["1"])),
        E1050 + "the file.parameters[0].initial[0] is no finite number",
    ),
    "true for a number": (
        _changed(lambda d: d["states"][0].update(next=True)),
        E1050 + "the file.states[0].next is no whole number",
    ),
    "unknown unit": (
        _changed(lambda d: d["signals"][0].update(unit="furlong")),
        E1050 + "the file.signals[0].unit: unknown unit `furlong`",
    ),
    "forward operand": (
        _changed(lambda d: d["step"][7].update(args=[900, 0])),
        E1052 + "node 7 uses a node that does not stand before it",
    ),
    "huge value": (
        _changed(lambda d: d["step"][0].update(axes=[["k", 1 << 40]])),
        E1052 + "node 0: Constant: [k=1099511627776] has more than 16777216 elements",
    ),
    "node of a state outside": (
        _changed(lambda d: d["states"][0].update(next=-1)),
        E1052 + "state `x` has other axes than its next value",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_file_gets_one_sentence(case: str) -> None:
    text, message = BAD[case]
    assert _failure(text) == message


STRANGE: tuple[Any, ...] = (None, True, -1, 1 << 60, 1e308, "", "x\n", [], {}, [[]], {"a": 1}, 0.5)


def _mutate(value: Any, choose: random.Random) -> Any:
    """The data with one place of it, at any depth, replaced, removed or doubled."""
    if isinstance(value, dict) and value and choose.random() < 0.9:
        data = dict(value)
        key = choose.choice(list(data))
        if choose.random() < 0.1:
            del data[key]
        else:
            data[key] = _mutate(data[key], choose)
        return data
    if isinstance(value, list) and value and choose.random() < 0.9:
        items = list(value)
        place = choose.randrange(len(items))
        match choose.randrange(8):
            case 0:
                del items[place]
            case 1:
                items.append(items[place])
            case _:
                items[place] = _mutate(items[place], choose)
        return items
    if isinstance(value, int) and choose.random() < 0.5:
        return value + choose.choice((-1, 1, 100))
    return choose.choice(STRANGE)


@pytest.mark.parametrize("name", ["fuzzy_local_models in step form", "joint_arm"])
def test_broken_data_never_raises_anything_else(name: str) -> None:
    good, choose = program_to_data(PROGRAMS[name]()), random.Random(11)
    refused = 0
    for _ in range(1500):
        try:
            program_from_data(_mutate(good, choose), "model.json")
        except SpecError:
            refused += 1
    assert refused > 500  # most changes break a rule; some rename a thing that nothing refers to


def test_changed_copies_differ() -> None:
    program = PROGRAMS["late_sensor"]()
    assert program_to_json(replace(program, doc="other")) != program_to_json(program)
