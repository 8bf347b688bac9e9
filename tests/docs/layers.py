"""Every layer of the language: its docstring, its options, and the arrays of an example."""

from __future__ import annotations

import ast
from collections.abc import Iterable
from functools import cache
from pathlib import Path

import compiler.layers
from compiler.elaboration.compile import compile_spec
from compiler.interpreter.operations import constant_value
from compiler.ir.program import Graph, Parameter, Program, State
from compiler.ir.types import UNNAMED, WINDOW, Axis
from spec_schema.fields.entry import kinds_of
from spec_schema.reading.reader import read_spec
from spec_schema.sections.layers import Layer
from spec_schema.sections.spec import Spec
from spec_schema.units.unit import Unit
from tests.docs.keys import options
from tests.docs.markdown import apart, paragraph, prose, table, wrapped

_FOLDER = Path(compiler.layers.__file__).parent
_EXAMPLES = Path(__file__).with_name("layers.yaml")


def layers() -> str:
    """A section a layer, in the order of the schema."""
    return apart(*(_layer(kind) for kind in Layer.known_keys()))


def _layer(kind: str) -> str:
    tree = ast.parse((_FOLDER / f"{kind}.py").read_text(encoding="utf-8"))
    (function,) = (
        node for node in tree.body if isinstance(node, ast.FunctionDef) and node.name == kind
    )
    about = paragraph(ast.get_docstring(tree)).removeprefix(f"`{kind}`: ")
    (entry,) = kinds_of(Layer.model_fields[kind].annotation)
    return apart(
        f"## `{kind}`",
        wrapped(about[:1].upper() + about[1:]),
        prose(ast.get_docstring(function)),
        options(entry),
        _example(kind),
    )


@cache
def _examples() -> tuple[Spec, Program, Program]:
    """The examples, compiled twice: initial values that differ are drawn."""
    spec = read_spec(_EXAMPLES, _EXAMPLES.read_text(encoding="utf-8")).spec
    return spec, compile_spec(spec).program, compile_spec(spec, draw=1).program


def _example(kind: str) -> str:
    """The example's lines of the spec, and what the program keeps for it."""
    spec, program, redrawn = _examples()
    names = [n for n, layer in spec.layers.items() if getattr(layer, kind) is not None]
    assert names, f"declare a layer of kind {kind} in tests/docs/layers.yaml, and an output {kind}"
    (name,) = names
    lines = [line.strip() for line in _EXAMPLES.read_text(encoding="utf-8").splitlines()]
    (declared,) = (line for line in lines if line.startswith(f"{name}: {{"))
    (called,) = (line for line in lines if line.startswith(f"{kind}: "))
    parts = [f"For example `{declared}`, called as `{called.removeprefix(f'{kind}: ')}`, has"]
    of_layer = f"{name}."
    rows = [
        _array(parameter, other)
        for parameter, other in zip(program.parameters, redrawn.parameters, strict=True)
        if parameter.name.startswith(of_layer)
    ]
    states = (state for state in program.states if state.name.startswith(of_layer))
    rows += [_memory(state, program.start) for state in states]
    if not rows:
        return wrapped(f"{parts[0]} no arrays.")
    header = ("array", "shape", "unit", "initially", "bounds", "")
    return apart(wrapped(f"{parts[0]}:"), table(header, rows))


def _array(parameter: Parameter, redrawn: Parameter) -> tuple[str, ...]:
    if parameter.statistic is not None:
        initially = "from the data"
    elif parameter.initial != redrawn.initial:
        initially = "drawn"
    else:
        initially = _numbers(parameter.initial)
    low, high = parameter.minimum, parameter.maximum
    bounds = "" if low is None else f"above {low:g}" if high is None else f"{low:g} … {high:g}"
    shape, unit = _shape(parameter.axes), _unit(parameter.unit)
    return f"`{parameter.name}`", shape, unit, initially, bounds, parameter.doc


def _memory(state: State, start: Graph) -> tuple[str, ...]:
    initially = _numbers(constant_value(start, state.start).ravel())
    return f"`{state.name}`", _shape(state.axes), _unit(state.unit), initially, "", state.doc


def _numbers(values: Iterable[float]) -> str:
    known = [f"{value:g}" for value in values]
    return known[0] if len(set(known)) == 1 else ", ".join(known)


def _shape(axes: tuple[Axis, ...]) -> str:
    """`axle (2) × samples (5)`; an axis inside the layer by the last part of its name."""
    words = {WINDOW: "samples", UNNAMED: "elements"}
    named = (words.get(axis.name, axis.name.rpartition(".")[2]) for axis in axes)
    shown = (f"{name} ({axis.size})" for name, axis in zip(named, axes, strict=True))
    return " × ".join(shown) or "scalar"


def _unit(unit: Unit | None) -> str:
    return "" if unit is None else f"`{unit.text}`"
