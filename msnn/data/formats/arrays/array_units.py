"""Finds the units that files and frames state of their arrays, apart from the arrays' names."""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any, TypeAlias, cast

import numpy as np

_KEYS = frozenset(("unit", "units"))
"""In small letters: the attribute `units` of CF and NeXus, `unit` of loggers."""
_VALUES = frozenset(("data", "value", "values", "samples", "y"))
"""Fields of a struct in which the numbers stand, beside a field with their unit."""
PANDAS_ATTRIBUTES = "PANDAS_ATTRS"
"""The key of Parquet's metadata below which pandas keeps `attrs`."""
_LONGEST = 200


UnitTexts: TypeAlias = Sequence[Sequence[str]]
"""What a file states of an array's unit: each statement is one text, or one for each column."""


def units_in(attributes: Any) -> UnitTexts:
    """The units in a mapping of attributes, in which `unit` and `units` may both be."""
    # attributes that cannot be read, as references of HDF5, are not looked at
    keys = [key for key in attributes if text_of(key).lower() in _KEYS]
    return [texts_of(attributes[key]) for key in keys]


def unit_of_array(array: Any) -> UnitTexts:
    """The unit that an array of a session has with it: of pandas and xarray in `attrs`, of pint in
    `units`, of astropy in `unit`."""
    attributes = getattr(array, "attrs", None)
    if attributes:
        return units_in(attributes)
    # those of dates and times of day are of numpy's ticks
    if getattr(getattr(array, "dtype", None), "kind", "f") in "mM":
        return ()
    for key in ("units", "unit"):
        if (unit := getattr(array, key, None)) is not None and not callable(unit):
            # pint's short format, as `km/h`
            return [(f"{unit:~C}" if hasattr(unit, "dimensionality") else str(unit),)]
    return ()


def unit_beside(names: Collection[str], name: str, get: Callable[[str], Any]) -> UnitTexts:
    """The units in texts of the same file: `speed_unit`, or `speed.unit` beside `speed.data`."""
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

    They are `{"units": {"speed": "km/h"}}`, `{"speed": {"units": "km/h"}}` or `speed_unit`. Parquet
    keeps mappings as JSON, and those that pandas has in `attrs` below a key of pandas.
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
    """A mapping, of which Parquet has the JSON; empty for anything else."""
    if isinstance(value, str | bytes):
        try:
            value = json.loads(value)
        except ValueError:
            return {}
    return cast("Mapping[Any, Any]", value) if isinstance(value, Mapping) else {}


def texts_of(value: Any) -> Sequence[str]:
    """The texts of an attribute or an array: a text, bytes, letters of MATLAB, or a list of texts.

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
    """A text, of bytes too."""
    if isinstance(value, bytes):
        # latin-1 has each byte, and `°` of old loggers
        try:
            return value.decode("utf-8")
        except UnicodeDecodeError:
            return value.decode("latin-1")
    return str(value)


def _are_texts(values: Any) -> bool:
    return all(isinstance(value, str | bytes) for value in values)
