"""Writes a ROS 2 node for the generated C, as a package in a separate folder."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from itertools import chain, count
from typing import Any
from xml.sax.saxutils import escape

from backends.c.functions.input_policy import nearest_to_zero
from backends.c.interface.interface import Field, Interface
from backends.c_language.literals import real_literal
from backends.c_language.rendering import comment_text, render, string_literal
from backends.files.text_templates import one_line, readme_text
from backends.ports.identifiers import c_identifier
from compiler.ir.program import Parameter, Program

_NANO = 1_000_000_000
_OF_ROS = ("use_sim_time", "start_type_description_service")
"""Parameters that every node declares itself; declaring them again aborts the launch."""


def ros2_texts(program: Program, interface: Interface, paths: Iterable[str]) -> dict[str, str]:
    """The ROS 2 package, path in the folder → text: node, CMake file, package.xml and README.
    `paths` are the other files of the folder; the package compiles those in `src/` except the
    self-test.
    """
    prefix = interface.prefix
    package = _ros_name(prefix)
    topics: set[str] = set()
    docs = {signal.name: signal.doc for signal in program.signals}
    outputs = {output.name: output.doc for output in program.outputs}
    tuned = interface.parameters if interface.options.moves_parameters else ()
    names: set[str] = set(_OF_ROS)
    every = program.sample_time
    facts: dict[str, Any] = {
        "package": package,
        "real": "float" if interface.options.dtype == "float32" else "double",
        "nanoseconds": None if every is None else round(every * _NANO),
        "seconds": None if every is None else f"{every:.9g}",
        "inputs": [
            _port(input.field, topics, docs[input.port.signal.name]) for input in interface.inputs
        ],
        "outputs": [_port(field, topics, outputs[field.name]) for field in interface.outputs],
        "status": c_identifier("status", topics),
        "parameters": [
            _parameter(interface, field, program.parameter(field.name), names) for field in tuned
        ],
        "starts": _starts(interface, names),
        "default": f"{prefix}_calibration.values"
        if interface.calibrates
        else f"{prefix}_params_default",
        "values": _values(interface),
        "sources": sorted(
            path
            for path in paths
            # a node needs no golden vectors
            if path.startswith("src/") and path.endswith(".c") and "_selftest" not in path
        ),
        "description": escape(" ".join((program.doc or program.name).split())),
    }

    # `facts` is read when a text is made: the two meanings of `node` below rely on it
    def text(template: str, title: str = "") -> str:
        return render(template, interface, title, "ros2", **facts)

    # C++ needs a string literal, CMake and the README the bare name of the executable
    facts["node"] = string_literal(package)
    files = {f"ros2/src/{prefix}_node.cpp": text("node.cpp.j2", "Node of ROS 2")}
    facts["node"] = f"{package}_node"
    files["ros2/CMakeLists.txt"] = text("CMakeLists.txt.j2")
    files["ros2/package.xml"] = text("package.xml.j2")
    files["ros2/README.md"] = readme_text("ros2", model=one_line(program.name), **facts)
    return files


def _ros_name(prefix: str) -> str:
    """The C prefix as the name of a ROS package: lower case, without double underscores, and with
    `model_` in front if it does not start with a letter.
    """
    found = re.sub("_+", "_", prefix.lower()).strip("_")
    return found if found[:1].isalpha() else f"model_{found}"


def _values(interface: Interface) -> str:
    """C text that follows the state argument in calls and passes the parameters: the node's own
    values, the constants, or nothing if the functions take no parameters.
    """
    if not interface.takes_parameters:
        return ""
    if interface.options.moves_parameters:
        return ", &values_"
    return f", &{interface.prefix}_params_default"


def _port(field: Field, topics: set[str], doc: str) -> dict[str, Any]:
    topic = f"~/{c_identifier(field.identifier, topics)}"
    return {**_facts(field, doc), "topic": string_literal(topic), "shown": topic}


def _parameter(
    interface: Interface, field: Field, parameter: Parameter, names: set[str]
) -> dict[str, Any]:
    name = _unused(field.name, names)
    low = -math.inf if parameter.minimum is None else parameter.minimum
    high = math.inf if parameter.maximum is None else parameter.maximum
    dtype = interface.options.dtype
    outside = f" || value < {real_literal(low, dtype)}" if low > -math.inf else ""
    outside += f" || value > {real_literal(high, dtype)}" if high < math.inf else ""
    bounds = f", or outside [{low:g}, {high:g}]" if outside else ""
    refusal = f"{name} is not finite{bounds}"
    return {
        **_facts(field, parameter.doc),
        "name": string_literal(name),
        "shown": one_line(name),
        "outside": outside,
        "refusal": string_literal(refusal),
    }


def _starts(interface: Interface, names: set[str]) -> list[dict[str, Any]]:
    """Values for the template: one dict per argument of `reset`, which the node declares as a ROS
    parameter. Empty unless some states need `reset` before the first step. Adds the parameters'
    names to `names`.
    """
    if not interface.from_record - interface.filled_by_first:
        return []
    given = [(field, port.signal.range, port.signal.doc) for field, port in interface.windows]
    given += [(field, state.range, state.doc) for field, state in interface.supplied]
    named = [_unused(f"start.{field.name}", names) for field, _, _ in given]
    return [
        {
            **_facts(field, f"{doc} around the first step"),
            "name": string_literal(name),
            "shown": one_line(name),
            # parameters of ROS are always doubles
            "value": real_literal(nearest_to_zero(limits, interface.options.dtype), "float64"),
        }
        for name, (field, limits, doc) in zip(named, given, strict=True)
    ]


def _unused(name: str, names: set[str]) -> str:
    """The name, with `_2`, `_3`, … appended if `names` has it already; adds the result to
    `names`.
    """
    numbered = (f"{name}_{k}" for k in count(2))
    found = next(each for each in chain([name], numbered) if each not in names)
    names.add(found)
    return found


def _facts(field: Field, doc: str) -> dict[str, Any]:
    unit = "" if field.unit is None else f" [{field.unit.text}]"
    size = f", {field.size} numbers" if field.shape else ""
    text = f"{field.name}{unit}{size}" + (f": {doc}" if doc.strip() else "")
    return {
        "member": field.identifier,
        "size": field.size,
        "is_array": bool(field.shape),
        "comment": comment_text(text),
        "doc": string_literal(text),
        "about": one_line(text).replace("|", "\\|"),
    }
