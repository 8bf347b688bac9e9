"""Ports follow from what outputs and states need, and their description survives any spec text."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import pytest

from backends.files.text_templates import one_line, readme_text
from backends.ports.metadata import interface_metadata, metadata_text
from backends.ports.step_interface import port_names, step_interface
from compiler.ir.builder import GraphBuilder
from compiler.ir.program import Output, Program, Role, Signal
from compiler.ir.types import Type
from compiler.passes.to_step_form import to_step_form
from tests.programs import SAMPLES


def _doubled(signal: Signal, **changes: str) -> Program:
    b = GraphBuilder()
    u = b.signal(signal.name, 0, 0, Type())
    outputs = (Output("y", b.add(u, u)),)
    nothing = GraphBuilder().graph()
    program = Program("double", 0.1, (signal,), (), (), b.graph(), nothing, outputs)
    return replace(program, **changes)


def test_losses_give_no_ports():
    program = to_step_form(SAMPLES["joint_arm"]().program)
    b = GraphBuilder(program.step)
    b.signal("unused", 0, 0, Type())
    program = replace(
        program, step=b.graph(), signals=(*program.signals, Signal("unused", Role.INPUT))
    )
    assert [port.signal.name for port in step_interface(program).inputs] == ["q", "tau"]


def test_a_program_in_window_form_is_refused():
    b = GraphBuilder()
    late = b.subtract(b.signal("u", 0, 0, Type()), b.signal("u", -1, -1, Type()))
    outputs, nothing = (Output("y", late),), GraphBuilder().graph()
    inputs = (Signal("u", Role.INPUT),)
    with pytest.raises(ValueError, match="`u` is read more than once"):
        step_interface(Program("window", 0.1, inputs, (), (), b.graph(), nothing, outputs))


def test_reading_the_record_in_an_output_is_refused():
    b = GraphBuilder()
    outputs, nothing = (Output("y", b.log("u", 0, 0, Type())),), GraphBuilder().graph()
    inputs = (Signal("u", Role.INPUT),)
    with pytest.raises(ValueError, match="the record of `u`"):
        step_interface(Program("log", 0.1, inputs, (), (), b.graph(), nothing, outputs))


def test_all_names_differ_from_one_another():
    program = to_step_form(SAMPLES["spring_damper_rk4"]().program)
    names = port_names(step_interface(program))
    tables = [names.inputs, names.states, names.parameters, names.outputs, names.next_states]
    all_names = [name for table in tables for name in table.values()]
    assert len(set(all_names)) == len(all_names)


def test_the_description_is_json_whatever_the_spec_says():
    signal = Signal("u", Role.INPUT, range=(0.0, math.inf), doc='a "quoted"\n*/ <b>text</b> \x00 ü')
    program = _doubled(signal, doc="```\n# no heading")
    interface = step_interface(program)
    metadata = interface_metadata(program, interface, port_names(interface))
    data = json.loads(metadata_text(metadata))
    assert data["inputs"][0]["doc"] == signal.doc
    assert data["inputs"][0]["range"] == [0.0, None]
    assert data["doc"] == program.doc


def test_a_readme_shows_a_name_as_one_line_of_text():
    name = one_line("a`b\n```python\nraise SystemExit\n```<script>")
    text = readme_text("casadi", model=name, prefix="model", version="3.8.2", source=True)
    assert text.splitlines()[0] == "# a'b '''python raise SystemExit '''‹script› for CasADi"
    harmless = readme_text("casadi", model="a", prefix="model", version="3.8.2", source=True)
    assert text.count("```") == harmless.count("```") > 0
