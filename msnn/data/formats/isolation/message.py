"""Writes the results of a reader as JSON and raw arrays, which run no code as a pickle may."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import fields
from typing import IO, Any, cast

import numpy as np

from msnn.data.dataset import FloatArray
from msnn.data.formats.table import ColumnTable, Streams
from msnn.data.formats.written_units import TwoUnits, UnknownUnit
from spec_schema.diagnostics.diagnostic import Diagnostic
from spec_schema.diagnostics.source import Span
from spec_schema.expressions.moments import Moment
from spec_schema.units.parser import parse_unit
from spec_schema.units.unit import Unit

_CLASSES = {
    kind.__name__: kind
    for kind in (ColumnTable, Streams, Diagnostic, Span, Moment, UnknownUnit, TwoUnits)
}
_LENGTH = 8
"""Bytes that say how long the JSON is."""
_LONGEST = 1 << 30


def write_message(pipe: IO[bytes], value: object) -> None:
    """Writes tables, streams, diagnostics, and tuples and mappings of such values."""
    arrays: list[FloatArray] = []
    text = json.dumps(_encoded(value, arrays)).encode()
    pipe.write(len(text).to_bytes(_LENGTH, "big"))
    pipe.write(text)
    # `value` still holds them: the system shares what both processes need
    for array in arrays:
        pipe.write(array.view(np.uint8).data)
    pipe.flush()


def read_message(pipe: IO[bytes]) -> Any:
    """The value of a message; EOFError where the writer has ended within it."""
    length = int.from_bytes(_whole(pipe, _LENGTH), "big")
    if length > _LONGEST:
        raise EOFError
    return _decoded(json.loads(_whole(pipe, length)), pipe)


def _whole(pipe: IO[bytes], count: int) -> bytes:
    found = pipe.read(count)
    if len(found) < count:
        raise EOFError
    return found


def _encoded(value: object, arrays: list[FloatArray]) -> object:
    match value:
        case None | bool() | int() | float() | str():
            return value
        case np.ndarray():
            array = np.ascontiguousarray(cast("FloatArray", value), np.float64)
            arrays.append(array)
            return {"array": len(array)}
        case tuple():
            items = cast("tuple[object, ...]", value)
            return {"tuple": [_encoded(item, arrays) for item in items]}
        case Mapping():
            entries = cast("Mapping[str | int, object]", value).items()
            return {"map": [[key, _encoded(item, arrays)] for key, item in entries]}
        case Unit():
            return {"unit": value.text}
        case (
            ColumnTable()
            | Streams()
            | Diagnostic()
            | Span()
            | Moment()
            | UnknownUnit()
            | TwoUnits()
        ):
            # cells of these files stand nowhere: their places are those of any table
            names = [field.name for field in fields(value) if field.init]
            names = [name for name in names if name not in ("place", "cell")]
            held = {name: _encoded(getattr(value, name), arrays) for name in names}
            return {"class": type(value).__name__, "fields": held}
        case _:
            raise TypeError(type(value))


def _decoded(value: Any, pipe: IO[bytes]) -> Any:
    match value:
        # in the order in which they were encoded, which is that of their bytes
        case {"array": count}:
            array = np.empty(int(count), np.float64)
            view = array.view(np.uint8).data
            filled = 0
            while filled < len(view):
                # of a buffered pipe
                got = cast("Any", pipe).readinto(view[filled:])
                if not got:
                    raise EOFError
                filled += got
            return array
        case {"tuple": items}:
            return tuple(_decoded(item, pipe) for item in items)
        case {"map": entries}:
            return {key: _decoded(item, pipe) for key, item in entries}
        case {"unit": text}:
            return parse_unit(text)
        case {"class": name, "fields": held}:
            known = {key: _decoded(item, pipe) for key, item in held.items()}
            return _CLASSES[name](**known)
        case _:
            return value
