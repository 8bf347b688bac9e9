"""Encodes requests and results of a reader as JSON and raw arrays; pickle could run code."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import IO, Any, cast

import numpy as np

from msnn.data.dataset import FloatArray
from msnn.data.formats.plugin_file import PluginReader
from msnn.data.formats.table import ColumnTable, Streams, TimeSource, WantedColumns
from msnn.data.formats.text.csv_header import Dialect
from msnn.data.formats.written_units import CapitalUnit, TwoUnits, UnknownUnit
from spec_schema.diagnostics.diagnostic import Diagnostic
from spec_schema.diagnostics.source import Span
from spec_schema.expressions.moments import Moment
from spec_schema.fields.leaf import Located
from spec_schema.units.parser import parse_unit
from spec_schema.units.unit import Unit


@dataclass(frozen=True, slots=True)
class ReadRequest:
    """A file to read, and limits of memory and time.

    The reader is that of a plug-in, or the function `read` of a module of msnn.
    """

    of: str | PluginReader
    path: Path
    shown: str
    wanted: WantedColumns
    dialect: Dialect
    memory: int
    """Maximum additional memory in bytes."""
    seconds: int
    """Maximum processor time."""


_REQUEST = (ReadRequest, WantedColumns, TimeSource, Located, Dialect, PluginReader)
_RESULT = (ColumnTable, Streams, Diagnostic, Span, Moment, CapitalUnit, UnknownUnit, TwoUnits)
_KINDS = (*_REQUEST, *_RESULT)
_CLASSES: dict[str, type[Any]] = {kind.__name__: kind for kind in _KINDS}
_LENGTH = 8
"""Size in bytes of the length field before the JSON."""
_LONGEST = 1 << 30


def write_message(pipe: IO[bytes], value: object) -> None:
    """Writes a request, a table, streams, or a tuple of diagnostics.

    TypeError for a value that contains an object of another class.
    """
    arrays: list[FloatArray] = []
    text = json.dumps(_encoded(value, arrays)).encode()
    pipe.write(len(text).to_bytes(_LENGTH, "big"))
    pipe.write(text)
    # `value` still holds them: the system shares what both processes need
    for array in arrays:
        pipe.write(array.view(np.uint8).data)
    pipe.flush()


def read_message(pipe: IO[bytes]) -> Any:
    """Reads one value. Raises EOFError if the message is incomplete."""
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
        case frozenset():
            items = cast("frozenset[object]", value)
            return {"set": [_encoded(item, arrays) for item in items]}
        case Mapping():
            entries = cast("Mapping[str | int, object]", value).items()
            return {"map": [[key, _encoded(item, arrays)] for key, item in entries]}
        case Unit():
            return {"unit": value.text}
        case Path():
            return {"path": str(value)}
        case _ if type(value) in _KINDS:
            # cells of these files stand nowhere: their places are those of any table
            left = ("place", "cell") if isinstance(value, ColumnTable) else ()
            of = fields(cast("Any", value))
            names = [field.name for field in of if field.init and field.name not in left]
            held = {name: _encoded(getattr(value, name), arrays) for name in names}
            return {"class": type(value).__name__, "fields": held}
        case _:
            raise TypeError(type(value))


def _decoded(value: Any, pipe: IO[bytes]) -> Any:
    match value:
        # decoded in the order of encoding, which is the order of the arrays' bytes
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
        case {"set": items}:
            return frozenset(_decoded(item, pipe) for item in items)
        case {"path": text}:
            return Path(text)
        case {"map": entries}:
            return {key: _decoded(item, pipe) for key, item in entries}
        case {"unit": text}:
            return parse_unit(text)
        case {"class": name, "fields": held}:
            known = {key: _decoded(item, pipe) for key, item in held.items()}
            return _CLASSES[name](**known)
        case _:
            return value
