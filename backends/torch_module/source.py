"""Writes a program as a torch module that does not depend on msnn, with its weights."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import torch
from numpy.typing import ArrayLike

from backends.files.atomic_write import write_bytes, write_text
from backends.files.safetensors_bytes import safetensors_bytes
from backends.files.text_templates import one_line, readme_text, text_templates
from backends.ports.identifiers import c_identifier
from backends.ports.step_interface import Port, StepInterface, step_interface
from backends.torch_module.lowering import (
    LoweredGraph,
    TorchLeaf,
    lower_graph,
    prepared,
    static_nodes,
)
from compiler.interpreter.interpreter import physical_weights
from compiler.ir.ops import ReadLog, ReadParameter, ReadSignal, ReadState
from compiler.ir.program import Graph, NodeId, Parameter, Program
from compiler.ir.types import Axis
from spec_schema.units.unit import Unit

# names that the generated file uses
_OWN_NAMES = {"inputs", "state", "windows", "batch", "torch", "self", "load_weights"}
STEP, START = "constant", "start_constant"
"""Prefixes of constants of the two functions; the step reads inputs, the start windows."""
# fx sets unused values to None, which makes the file hard to read
_RELEASES = re.compile(r";  (?:\w+ = )+None$")


def torch_source(program: Program, prefix: str, dtype: str) -> str:
    """The text of `<prefix>.py`: a torch module of the program that needs only torch. The same
    program gives the same text. `program` is in step form: a step reads each input once, and states
    store its past samples. `dtype` is the module's default precision. Names and descriptions of the
    spec appear as text only, never as code.
    """
    program = prepared(program)
    interface = step_interface(program)
    names = _attribute_names(program)
    # one list of roots, which is split again after the outputs
    outputs = [output.node for output in program.outputs]
    nexts = [state.next for state in program.states]
    step = _function(program.step, outputs + nexts, interface, names, STEP)
    start = _function(program.start, [s.start for s in program.states], interface, names, START)
    # only learned parameters need parametrizations for their bounds
    learned = [p for p in program.parameters if p.learn]
    return (
        text_templates("torch", strips=True)
        .get_template("module.py.j2")
        .render(
            model=_quoted(program.name),
            doc=_quoted(program.doc),
            made_by=program.made_by,
            prefix=prefix,
            dtype=dtype,
            sample_time=program.sample_time,
            ports=_port_lines(program, interface),
            parameters=[_parameter(parameter, names) for parameter in program.parameters],
            bounded=any(_bounds(parameter) for parameter in learned),
            step=step,
            start=start,
            outputs=list(zip((repr(o.name) for o in program.outputs), step.results, strict=False)),
            next_states=list(
                zip(
                    (repr(s.name) for s in program.states),
                    step.results[len(outputs) :],
                    strict=True,
                )
            ),
            states=list(zip((repr(s.name) for s in program.states), start.results, strict=True)),
            has_tensors=bool(interface.inputs or program.states),
            has_windows=bool(interface.start_windows),
        )
    )


@dataclass(frozen=True, slots=True)
class _Function:
    """The Python code of a function: lines of its body, expressions of its results, and constants
    as (name, expression).
    """

    lines: list[str]
    results: list[str]
    needs_batch: bool
    """True if a result has no batch axis and is repeated along it."""
    constants: list[tuple[str, str]]


def _function(
    graph: Graph,
    roots: list[NodeId],
    interface: StepInterface,
    names: dict[str, str],
    constants: str,
) -> _Function:
    # in double, so that constants are written with all digits
    lowered = lower_graph(graph, roots, torch.float64, identify=_argument_name, constants=constants)
    arguments = lowered.module.graph.find_nodes(op="placeholder")
    lines = [
        f"{argument.name} = {_source(leaf, interface, names, constants)}"
        for argument, leaf in zip(arguments, lowered.leaves, strict=True)
    ]
    lines += _body(lowered)
    static = static_nodes(graph)
    (output,) = lowered.module.graph.find_nodes(op="output")
    results = [
        f"{value.name}.expand({', '.join(['batch', *map(str, graph[root].type.shape)])})"
        if static[root]
        else str(value.name)
        for root, value in zip(roots, _results(output.args[0]), strict=True)
    ]
    buffers = [
        (name, _array_text(tensor.ravel().tolist(), tuple(tensor.shape)))
        for name, tensor in lowered.module.named_buffers()
    ]
    return _Function(lines, results, any(static[root] for root in roots), buffers)


def _results(value: Any) -> tuple[Any, ...]:
    assert isinstance(value, tuple)
    return value


def _body(lowered: LoweredGraph) -> list[str]:
    """The assignments that fx prints for the graph; those with a name in the spec have it and its
    line as a comment.
    """
    code = lowered.module.graph.python_code("self").src
    lines: list[str] = []
    for line in code.splitlines():
        statement = _RELEASES.sub("", line.strip())
        name, equals, _ = statement.partition(" = ")
        # the template has the signature and `return`: keep only assignments
        if not equals or not name.isidentifier():
            continue
        origin = lowered.origins.get(name)
        label = "" if origin is None or origin.label is None else f" {_comment(origin.label)}"
        place = "" if origin is None or origin.span is None else f" line {origin.span.line}"
        note = f"  #{label}{place}" if label else ""
        lines.append(statement + note)
    return lines


def _argument_name(leaf: TorchLeaf) -> str:
    match leaf.source:
        case ReadParameter(name) | ReadState(name) | ReadSignal(name) | ReadLog(name):
            # a new set for each: fx itself numbers equal names
            return c_identifier(name, {*_OWN_NAMES})
        case _:
            raise AssertionError("an exported step is one piece")


def _source(
    leaf: TorchLeaf, interface: StepInterface, names: dict[str, str], constants: str
) -> str:
    """The Python expression that the generated class uses for an argument, such as `inputs['u']`.
    `names` are the attributes of parameters; `constants` is STEP or START, which tells the
    function.
    """
    match leaf.source:
        case ReadParameter(name):
            return f"self.{names[name]}"
        case ReadState(name):
            return f"state[{name!r}]"
        case ReadSignal(name, first, last):
            if constants == STEP:
                return f"inputs[{name!r}]"
            return _window(leaf, name, first, last, interface)
        case ReadLog(name, first, last):
            return _window(leaf, name, first, last, interface)
        case _:
            raise AssertionError("an exported step is one piece")


def _window(leaf: TorchLeaf, name: str, first: int, last: int, interface: StepInterface) -> str:
    whole = next(port for port in interface.start_windows if port.signal.name == name)
    # `windows` has all samples that any state reads; indices start at the oldest
    start, stop = first - whole.first, last - whole.first + 1
    return f"windows[{name!r}][..., {f'{start}:{stop}' if leaf.windowed else start}]"


def _attribute_names(program: Program) -> dict[str, str]:
    # attributes of torch.nn.Module must not be overwritten
    taken = {*dir(torch.nn.Module()), *_OWN_NAMES, "parametrizations", "parameter_names"}
    return {p.name: c_identifier(p.name, taken) for p in program.parameters}


def _parameter(parameter: Parameter, names: dict[str, str]) -> dict[str, Any]:
    shape = tuple(axis.size for axis in parameter.axes)
    return {
        "key": repr(parameter.name),
        "attribute": names[parameter.name],
        "initial": _array_text(list(parameter.initial), shape),
        "learn": parameter.learn,
        "bounds": _bounds(parameter),
    }


def _bounds(parameter: Parameter) -> str:
    """The Python expression of the parametrization that keeps a parameter within its bounds, such
    as `Above(0.0, 1.0)`; empty without bounds.
    """
    match parameter.minimum, parameter.maximum:
        case None, None:
            return ""
        case low, None:
            # repr() restores the exact bits of the bound
            return f"Above({low!r}, {parameter.scale!r})"
        case None, high:
            return f"Below({high!r}, {parameter.scale!r})"
        case low, high:
            return f"Between({low!r}, {high!r})"


def _port_lines(program: Program, interface: StepInterface) -> list[tuple[str, list[str]]]:
    """The sections of the class's docstring: heading, and a line for each input, state, output,
    parameter and window.
    """
    outputs = [(o.name, program.step[o.node].type, o.doc) for o in program.outputs]
    return [
        ("Inputs", [_port_line(port) for port in interface.inputs]),
        ("States", [_line(s.name, s.axes, s.unit, s.doc) for s in program.states]),
        ("Outputs", [_line(name, type.axes, type.unit, doc) for name, type, doc in outputs]),
        ("Parameters", [_line(p.name, p.axes, p.unit, p.doc, ()) for p in program.parameters]),
        ("Windows for `initial_state`", [_port_line(port) for port in interface.start_windows]),
    ]


def _port_line(port: Port) -> str:
    signal = port.signal
    when = "" if port.first == port.last == 0 else f" samples t{port.first:+d} … t{port.last:+d}"
    return _line(signal.name, port.type.axes, signal.unit, signal.doc) + when


def _line(
    name: str,
    axes: tuple[Axis, ...],
    unit: Unit | None,
    doc: str,
    before: tuple[str, ...] = ("batch",),
) -> str:
    shape = ", ".join([*before, *(f"{axis.name or 'element'}={axis.size}" for axis in axes)])
    described = f": {doc}" if doc else ""
    return _quoted(f"{name} ({shape}) [{unit.text if unit else '?'}]{described}")


def _array_text(values: list[float], shape: tuple[int, ...]) -> str:
    # repr() of ∞ and NaN is not valid Python
    numbers = [repr(v) if math.isfinite(v) else f'float("{v}")' for v in values]
    return f"array({', '.join(['[' + ', '.join(numbers) + ']', *map(str, shape)])})"


def _quoted(text: str) -> str:
    """Text of a spec for use between triple quotes in Python: in one line, with quotes and
    backslashes escaped.
    """
    # the text must not end the docstring or start an escape sequence
    plain = " ".join("".join(c if c.isprintable() else " " for c in text).split())
    return plain.replace("\\", "\\\\").replace('"', '\\"')


def _comment(text: str) -> str:
    # a line break in a name would end the comment and start code
    return "".join(c if c.isprintable() else "_" for c in text)[:60]


def write_torch(
    program: Program,
    weights: Mapping[str, ArrayLike] | None,
    folder: Path,
    prefix: str,
    dtype: Literal["float32", "float64"] = "float64",
) -> tuple[Path, ...]:
    """Writes `<prefix>.py`, `<prefix>.safetensors` and a README, `<prefix>_torch.md`, to `folder`;
    returns their paths. The program is in step form. `weights` are physical arrays by name; a
    missing one, or None, means initial values. `dtype` is the default precision of the module's
    `load`. Raises ValueError for a program in window form or a weight of a wrong shape, OSError if
    a file cannot be written.
    """
    # checked first, so that a wrong weight leaves no files
    arrays = physical_weights(program, weights or {})
    metadata = {"program": program.name, "spec_sha256": program.spec_hash}
    interface = step_interface(program)
    readme = readme_text(
        "torch",
        model=one_line(program.name),
        prefix=prefix,
        windows=_zeros(interface.start_windows, dtype),
        inputs=_zeros(interface.inputs, dtype),
    )
    return (
        write_text(folder / f"{prefix}.py", torch_source(program, prefix, dtype)),
        write_bytes(folder / f"{prefix}.safetensors", safetensors_bytes(arrays, metadata)),
        write_text(folder / f"{prefix}_torch.md", readme),
    )


def _zeros(ports: Iterable[Port], dtype: str) -> str:
    """A Python expression: a dict of zero tensors (1, *shape) by name of port, for the README."""
    entries = [
        f"{port.signal.name!r}: torch.zeros({(1, *port.type.shape)}, dtype=torch.{dtype})"
        for port in ports
    ]
    return f"{{{', '.join(entries)}}}"
