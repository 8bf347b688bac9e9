"""Programs as JSON text: `msnn compile` writes such files, and the other commands accept them
instead of a spec.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from pathlib import PurePath
from typing import Any, TypeVar, cast

from compiler.ir.program import (
    Dimension,
    Expected,
    Fit,
    Formula,
    Graph,
    Loss,
    Node,
    Output,
    Parameter,
    Program,
    Signal,
    State,
    UsedPlugin,
)
from compiler.ir.verifier import InvalidProgram, verify
from compiler.program_file.fields import (
    Data,
    Malformed,
    PlainRecord,
    Shared,
    as_text,
    read,
    to_data,
)
from spec_schema.diagnostics.diagnostic import SpecError
from spec_schema.errors import files

Made = TypeVar("Made")


def read_program(data: Any) -> Program:
    """The program in the parsed JSON `data`; it is not verified yet. Raises Malformed."""
    record = PlainRecord(data, "the file")
    record.integer("format")
    shared = Shared(record.items("files", as_text))

    def reading(make: type[Made]) -> Callable[[Any, str], Made]:
        return lambda item, place: read(make, item, place, shared)

    program = Program(
        name=record.text("name"),
        sample_time=record.number("sample_time") if record.has("sample_time") else None,
        signals=record.items("signals", reading(Signal)),
        parameters=record.items("parameters", reading(Parameter)),
        states=record.items("states", reading(State)),
        step=Graph(record.items("step", reading(Node))),
        start=Graph(record.items("start", reading(Node))),
        outputs=record.items("outputs", reading(Output)),
        losses=record.items("losses", reading(Loss)),
        expected=record.items("expected", reading(Expected)) if record.has("expected") else (),
        fits=record.items("fits", reading(Fit)) if record.has("fits") else (),
        dimensions=record.items("dimensions", reading(Dimension)),
        formulas=record.items("formulas", reading(Formula)) if record.has("formulas") else (),
        plugins=record.items("plugins", reading(UsedPlugin)) if record.has("plugins") else (),
        doc=record.text("doc"),
        spec_hash=record.text("spec_hash"),
    )
    # unknown keys are refused, since they may change the meaning of the program
    record.close()
    return program


FORMAT = 1
"""Version of the file; readers refuse another one."""


def program_to_data(program: Program) -> Data:
    """Dictionaries, lists, strings and numbers for JSON, from which `program_from_data` restores
    the program.

    Numbers keep every bit. Units are written as text. Places name their spec file without its
    folder, unless two files have the same name. Fields with their default value are omitted.
    """
    names = _names_of_files(program)
    shared = Shared(tuple(names.values()), numbers={path: i for i, path in enumerate(names)})
    data: Data = {
        "format": FORMAT,
        "name": program.name,
        "doc": program.doc,
        "spec_hash": program.spec_hash,
        "sample_time": program.sample_time,
        "files": list(shared.files),
        "dimensions": [to_data(dimension, shared) for dimension in program.dimensions],
        "signals": [to_data(signal, shared) for signal in program.signals],
        "parameters": [to_data(parameter, shared) for parameter in program.parameters],
        "states": [to_data(state, shared) for state in program.states],
        "start": [to_data(node, shared) for node in program.start.nodes],
        "step": [to_data(node, shared) for node in program.step.nodes],
        "outputs": [to_data(output, shared) for output in program.outputs],
        "losses": [to_data(loss, shared) for loss in program.losses],
    }
    if program.expected:
        data["expected"] = [to_data(entry, shared) for entry in program.expected]
    if program.fits:
        data["fits"] = [to_data(fit, shared) for fit in program.fits]
    if program.formulas:
        data["formulas"] = [to_data(formula, shared) for formula in program.formulas]
    if program.plugins:
        data["plugins"] = [to_data(plugin, shared) for plugin in program.plugins]
    return data


def _names_of_files(program: Program) -> dict[str, str]:
    """For each path of a spec, the shortest end of the path that distinguishes it from
    all others.
    """
    spans = [node.span for graph in (program.start, program.step) for node in graph.nodes]
    for declared in (program.signals, program.parameters, program.states):
        spans += [item.span for item in declared]
    for declared in (program.outputs, program.losses, program.expected, program.formulas):
        spans += [item.span for item in declared]
    parts = {span.file: PurePath(span.file).parts for span in spans if span is not None}
    return {path: "/".join(own[-_length(own, parts.values()) :]) for path, own in parts.items()}


def _length(own: tuple[str, ...], every: Iterable[tuple[str, ...]]) -> int:
    """The number of last parts of the path `own` that distinguish it from all other paths in
    `every`.
    """
    others = [parts for parts in every if parts != own]
    lengths = range(1, len(own) + 1)
    return next((n for n in lengths if all(p[-n:] != own[-n:] for p in others)), len(own))


LONGEST_TEXT = 256 << 20
"""Maximum number of characters of a program file."""


def program_to_json(program: Program) -> str:
    """The program as JSON text, one node per line; equal programs give the same text."""
    return data_to_json(program_to_data(program))


def program_from_json(text: str, name: str) -> Program:
    """Reads a program from the text of a file; `name` is its name in diagnostics.

    Safe for untrusted text: sizes are limited and the program is verified. Raises SpecError if the
    text is no program.
    """
    return program_from_data(data_from_json(text, name), name)


def data_from_json(text: str, name: str) -> Any:
    """Parses the text of a program file without interpreting it, for callers that store more in it.
    `name` is its name in diagnostics. Raises SpecError if the text is no JSON or too long.
    """
    if len(text) > LONGEST_TEXT:
        raise SpecError([files.not_a_program(name, "it is too long")])
    try:
        # Python reads NaN and Infinity, which JSON does not have
        return json.loads(text, parse_constant=_no_number)
    except (ValueError, RecursionError) as error:
        reason = "it is not JSON" if isinstance(error, ValueError) else "it is nested too deep"
        raise SpecError([files.not_a_program(name, reason)]) from error


def program_from_data(data: Any, name: str) -> Program:
    """Reads a program from parsed JSON, as written by `program_to_data`, and verifies it. `name` is
    the file's name in diagnostics. Raises SpecError if the data are no legal program.
    """
    try:
        found = PlainRecord(data, "the file").integer("format")
        if found != FORMAT:
            raise SpecError([files.other_format(name, found, FORMAT)])
        program = read_program(data)
        verify(program)
    except Malformed as error:
        raise SpecError([files.not_a_program(name, str(error))]) from error
    except InvalidProgram as error:
        raise SpecError([files.illegal_program(name, error.reason)]) from error
    return program


def data_to_json(data: dict[str, Any]) -> str:
    """JSON text of the object `data`, with one line per item of its lists, so that files can be
    compared by line. Raises ValueError for NaN or infinity.
    """
    fields: list[str] = []
    for key, value in data.items():
        if isinstance(value, list) and value:
            items = ",\n".join(f"  {_line(item)}" for item in cast("list[Any]", value))
            fields.append(f"{_line(key)}: [\n{items}\n]")
        else:
            fields.append(f"{_line(key)}: {_line(value)}")
    return "{\n" + ",\n".join(fields) + "\n}\n"


def _line(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False, allow_nan=False)


def _no_number(text: str) -> float:
    raise ValueError(text)
