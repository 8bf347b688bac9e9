"""Reads the attributes of arrays: their units, and how values are packed (`scale_factor`)."""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

_UNIT_KEYS = frozenset(("unit", "units"))
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
    keys = [key for key in attributes if text_of(key).lower() in _UNIT_KEYS]
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
            if key.lower() in _UNIT_KEYS and head.lower() == stem.lower():
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
        elif text_of(key).lower() in _UNIT_KEYS and name in mapping:
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


_FACTOR, _SUMMAND, _UNSIGNED = "scale_factor", "add_offset", "_Unsigned"
_MISSING = ("_FillValue", "missing_value")
_LEAST, _MOST, _RANGE = "valid_min", "valid_max", "valid_range"
_PACKING_KEYS = frozenset((_FACTOR, _SUMMAND, _UNSIGNED, *_MISSING, _LEAST, _MOST, _RANGE))


class PackingError(ValueError):
    """Values cannot be unpacked because of an attribute; the text gives the reason."""


def packing_in(attributes: Any) -> dict[str, Any]:
    """The attributes for unpacking, selected from the attributes of an array or a column."""
    # others are not even read: references of HDF5 cannot be
    found = {text_of(key): attributes[key] for key in attributes if text_of(key) in _PACKING_KEYS}
    # a series has the attributes of its frame, which are mappings by column
    return {key: value for key, value in found.items() if not isinstance(value, Mapping)}


def packing_of_column(attributes: Any, name: str) -> dict[str, Any]:
    """The attributes for unpacking a column, selected from the attributes of its table.

    Accepted forms: `{"speed": {"scale_factor": 0.1}}` and `{"scale_factor": {"speed": 0.1}}`.
    """
    found: dict[str, Any] = {}
    for key, value in attributes.items():
        held = mapping_of(value)
        if text_of(key) == PANDAS_ATTRIBUTES:
            found |= packing_of_column(held, name)
        elif text_of(key) == name:
            found |= packing_in(held)
        elif text_of(key) in _PACKING_KEYS and name in held:
            found[text_of(key)] = held[name]
    return found


def with_netcdf_fill(packing: Mapping[str, Any], dtype: np.dtype[Any]) -> Mapping[str, Any]:
    """The attributes with NetCDF's default fill value, which marks values that were never written.

    Source: NC_FILL_* of netcdf.h; one-byte types have no default.
    """
    fill = _NETCDF_FILLS.get(dtype.str[1:])
    return packing if fill is None else {_MISSING[0]: dtype.type(fill), **packing}


_NETCDF_FILLS = {
    "i2": -32767,
    "u2": 65535,
    "i4": -2147483647,
    "u4": 4294967295,
    "i8": -9223372036854775806,
    "u8": 18446744073709551614,
    "f4": 9.969209968386869e36,
    "f8": 9.969209968386869e36,
}


def unpacked(array: NDArray[Any], packing: Mapping[str, Any]) -> NDArray[Any]:
    """array * scale_factor + add_offset; NaN if the packed value is missing or outside its limits.

    Fill values and limits apply to packed values. Non-numeric arrays are returned unchanged. Raises
    PackingError. Source: CF conventions 1.11, sections 2.5.1 and 8.1.
    """
    if not packing or array.dtype.kind not in "biuf":
        return array
    if array.dtype.kind == "i" and text_of(packing.get(_UNSIGNED, "")).lower() == "true":
        array = array.view(array.dtype.str.replace("i", "u"))
    with np.errstate(invalid="ignore"):
        missing = np.zeros(array.shape, np.bool_)
        for key in _MISSING:
            for number in _numbers(packing, key):
                missing |= array == number.astype(array.dtype)
        low, high = _limits(packing)
        missing |= (array < low) | (array > high)
        found = array.astype(np.float64)
        for key, apply in ((_FACTOR, np.multiply), (_SUMMAND, np.add)):
            numbers = _numbers(packing, key)
            if len(numbers) > 1:
                message = f"its `{key}` has {len(numbers)} numbers"
                raise PackingError(message)
            for number in numbers:
                # a factor 0.1 of 32 bits is 0.1, not 0.10000000149
                found = apply(found, np.float64(str(number)))
    found[missing] = np.nan
    return found


def scaling(packing: Mapping[str, Any]) -> str:
    """The attributes that scale or shift values, for messages; empty if they have no effect.

    Raises PackingError.
    """
    neutral = {_FACTOR: 1.0, _SUMMAND: 0.0}
    found = ((key, n) for key in neutral for n in _numbers(packing, key) if n != neutral[key])
    return ", ".join(f"{key} {number}" for key, number in found)


def _limits(packing: Mapping[str, Any]) -> tuple[Any, Any]:
    both = _numbers(packing, _RANGE)
    if len(both) not in (0, 2):
        message = f"its `{_RANGE}` has {len(both)} numbers"
        raise PackingError(message)
    low, high = both if len(both) else (-np.inf, np.inf)
    return max((low, *_numbers(packing, _LEAST))), min((high, *_numbers(packing, _MOST)))


def _numbers(packing: Mapping[str, Any], key: str) -> NDArray[Any]:
    """The numeric values of an attribute, also of its text as Parquet saves it; empty if absent."""
    value = packing.get(key, ())
    if isinstance(value, str | bytes):
        value = text_of(value).strip("[] ").replace(",", " ").split()
    numbers = np.ravel(np.asarray(value))
    try:
        if numbers.dtype.kind not in "biuf":
            numbers = numbers.astype(np.float64)
    except (TypeError, ValueError) as error:
        message = f"its `{key}` is no number"
        raise PackingError(message) from error
    return numbers
