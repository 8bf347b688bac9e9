"""Finds the units that files and frames state for their arrays, apart from the arrays' names."""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any, TypeAlias, cast

import numpy as np

_KEYS = frozenset(("unit", "units"))
"""Attribute names in lower case: `units` in CF and NeXus, `unit` in data loggers."""
_VALUES = frozenset(("data", "value", "values", "samples", "y"))
"""Fields of a struct that contain the values, next to a field with their unit."""
PANDAS_ATTRIBUTES = "PANDAS_ATTRS"
"""The Parquet metadata key under which pandas saves `attrs`."""
_LONGEST = 200


UnitTexts: TypeAlias = Sequence[Sequence[str]]
"""The statements of a file about an array's unit: each is one text, or one text per column."""


def units_in(attributes: Any) -> UnitTexts:
    """The units in a mapping of attributes; `unit` and `units` may both be present."""
    # other attributes are never read: some, such as HDF5 references, cannot be
    keys = [key for key in attributes if text_of(key).lower() in _KEYS]
    return [texts_of(attributes[key]) for key in keys]


def unit_of_array(array: Any) -> UnitTexts:
    """The unit attached to an array of a frame.

    pandas and xarray have it in `attrs`, pint in `units`, astropy in `unit`.
    """
    attributes = getattr(array, "attrs", None)
    if attributes:
        return units_in(attributes)
    # for datetime64 and timedelta64, a unit would be that of numpy's ticks
    if getattr(getattr(array, "dtype", None), "kind", "f") in "mM":
        return ()
    for key in ("units", "unit"):
        if (unit := getattr(array, key, None)) is not None and not callable(unit):
            # pint's short format, as `km/h`
            return [(f"{unit:~C}" if hasattr(unit, "dimensionality") else str(unit),)]
    return ()


def unit_beside(names: Collection[str], name: str, get: Callable[[str], Any]) -> UnitTexts:
    """Units in other arrays of the file: `speed_unit` for `speed`, `speed.unit` for
    `speed.data`.
    """
    stems = [(name, "_")]
    for sign in "./":
        base, found, field = name.rpartition(sign)
        if found and field.lower() in _VALUES:
            stems.append((base, sign))
    exact: list[str] = []
    folded: list[str] = []
    for other in names:
        for stem, sign in stems:
            head, _, key = other.rpartition(sign)
            if key.lower() in _KEYS and head.lower() == stem.lower():
                (exact if head == stem else folded).append(other)
    # `P` and `p` may be a power and a pressure: then a name has the unit that is spelled like it
    if sum(other.lower() == name.lower() for other in names) > 1:
        folded = []
    return [texts_of(get(other)) for other in exact or folded]


def unit_of_column(attributes: Any, name: str) -> UnitTexts:
    """The units of a column in the attributes of its table.

    Accepted forms: `{"units": {"speed": "km/h"}}`, `{"speed": {"units": "km/h"}}` and `speed_unit`.
    Parquet saves mappings as JSON, and pandas' `attrs` under a key of pandas.
    """
    found: list[Sequence[str]] = []
    for key, value in attributes.items():
        mapping = mapping_of(value)
        if text_of(key) == PANDAS_ATTRIBUTES:
            found += unit_of_column(mapping, name)
        elif text_of(key).lower() in _KEYS and name in mapping:
            found.append(texts_of(mapping[name]))
        elif text_of(key) == name:
            found += units_in(mapping)
    texts = {text_of(key): value for key, value in attributes.items()}
    return [*found, *unit_beside(texts, name, texts.__getitem__)]


def mapping_of(value: Any) -> Mapping[Any, Any]:
    """A mapping, or the mapping in a JSON text as Parquet saves it; empty for anything else."""
    if isinstance(value, str | bytes):
        try:
            value = json.loads(value)
        except ValueError:
            return {}
    return cast("Mapping[Any, Any]", value) if isinstance(value, Mapping) else {}


def texts_of(value: Any) -> Sequence[str]:
    """The texts in an attribute or array: str, bytes, MATLAB character codes or a list of texts.

    Empty for anything else.
    """
    if isinstance(value, str | bytes):
        return (text_of(value),)
    array = np.asarray(value)
    if array.size > _LONGEST:
        return ()
    # MATLAB keeps the letters of a text as numbers in files of 7.3
    if array.dtype == np.uint16:
        return ("".join(chr(code) for code in array.ravel()),)
    if array.dtype.kind not in "OSU":
        return ()
    return tuple(map(text_of, array.ravel())) if _are_texts(array.ravel()) else ()


def text_of(value: Any) -> str:
    """The value as str; bytes are decoded as UTF-8, else as Latin-1."""
    if isinstance(value, bytes):
        # latin-1 has each byte, and `°` of old loggers
        try:
            return value.decode("utf-8")
        except UnicodeDecodeError:
            return value.decode("latin-1")
    return str(value)


def _are_texts(values: Any) -> bool:
    return all(isinstance(value, str | bytes) for value in values)
