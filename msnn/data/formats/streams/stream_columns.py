"""Extracts columns from recordings in which every signal has its own timestamps."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from msnn.data.dataset import FloatArray
from msnn.data.formats.arrays.array_columns import NamedArrays
from msnn.data.formats.table import ColumnKey, Streams, WantedColumns
from msnn.data.formats.written_units import StatedUnit
from msnn.errors.data import files as errors
from spec_schema.diagnostics.diagnostic import Diagnostic, SpecError

Lookup = Callable[[str], tuple[FloatArray, NamedArrays] | None]
"""Column name → times in seconds and values under that name; None if there is no such column."""


def stream_columns(file: str, wanted: WantedColumns, names: Sequence[str], find: Lookup) -> Streams:
    """The requested columns; an integer key is an index into `names`.

    Raises SpecError with all errors of the file.
    """
    faults: list[Diagnostic] = []
    missing: dict[str, str] = {}
    columns: dict[ColumnKey, tuple[FloatArray, FloatArray]] = {}
    units: dict[ColumnKey, StatedUnit] = {}
    packed: dict[ColumnKey, str] = {}
    for key, user in wanted.users.items():
        name = key if isinstance(key, str) else names[key] if key < len(names) else None
        try:
            found = None if name is None else find(name)
            if found is None or name is None:
                if key not in wanted.spare:
                    missing[str(key)] = user
                continue
            time, values = found
            # each stream is a table of one column, with the rules of tables
            optional = frozenset({name}) if key in wanted.optional else frozenset[ColumnKey]()
            marks: dict[ColumnKey, frozenset[str]] = {name: wanted.missing.get(key, frozenset())}
            table = values.table(WantedColumns({name: user}, optional, missing=marks))
            columns[key] = (time, table.columns[name])
            if name in table.units:
                units[key] = table.units[name]
            if name in table.packed:
                packed[key] = table.packed[name]
        except SpecError as error:
            faults += error.diagnostics
    if missing:
        faults.append(errors.missing_columns(missing, file, names, None, numbers=False))
    if faults:
        raise SpecError(faults)
    return Streams(columns, units, packed=packed)
