"""Programs as JSON: `msnn compile` writes them and every other command accepts them."""

from __future__ import annotations

import json
from typing import Any, cast

from compiler.ir.program import Program
from compiler.ir.rules.verifier import InvalidProgram, verify
from compiler.program_file.plain_data import Malformed, PlainRecord
from compiler.program_file.reader import read_program
from compiler.program_file.writer import FORMAT, program_to_data
from spec_schema.diagnostics.diagnostic import SpecError
from spec_schema.errors import files

__all__ = [
    "data_from_json",
    "data_to_json",
    "program_from_data",
    "program_from_json",
    "program_to_data",
    "program_to_json",
]

LONGEST_TEXT = 256 << 20
"""Maximum number of characters of a program file."""


def program_to_json(program: Program) -> str:
    """Writes a program as JSON, deterministically, with one node per line."""
    return data_to_json(program_to_data(program))


def program_from_json(text: str, name: str) -> Program:
    """Reads a program from the text of a file; `name` is its name in diagnostics.

    Safe for untrusted text: sizes are limited and the program is verified. Raises SpecError.
    """
    return program_from_data(data_from_json(text, name), name)


def data_from_json(text: str, name: str) -> Any:
    """Parses the text of a program file, for callers that store more in it. Raises SpecError."""
    if len(text) > LONGEST_TEXT:
        raise SpecError([files.not_a_program(name, "it is too long")])
    try:
        # Python reads NaN and Infinity, which JSON does not have
        return json.loads(text, parse_constant=_no_number)
    except (ValueError, RecursionError) as error:
        reason = "it is not JSON" if isinstance(error, ValueError) else "it is nested too deep"
        raise SpecError([files.not_a_program(name, reason)]) from error


def program_from_data(data: Any, name: str) -> Program:
    """Reads a program from parsed JSON, as written by `program_to_data`. Raises SpecError."""
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
    """JSON with one line per item of the top-level lists, so that files can be compared by line."""
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
