"""Unpacks numbers by the attributes that files have with them, as the CF conventions define."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from msnn.data.formats.arrays.array_units import PANDAS_ATTRIBUTES, mapping_of, text_of

_FACTOR, _SUMMAND, _UNSIGNED = "scale_factor", "add_offset", "_Unsigned"
_MISSING = ("_FillValue", "missing_value")
_LEAST, _MOST, _RANGE = "valid_min", "valid_max", "valid_range"
_KEYS = frozenset((_FACTOR, _SUMMAND, _UNSIGNED, *_MISSING, _LEAST, _MOST, _RANGE))


class PackingError(ValueError):
    """An attribute by which numbers cannot be unpacked; the text says why."""


def packing_in(attributes: Any) -> dict[str, Any]:
    """The attributes of packed numbers among those of an array or a column."""
    # others are not even read: references of HDF5 cannot be
    found = {text_of(key): attributes[key] for key in attributes if text_of(key) in _KEYS}
    # a series has the attributes of its frame, which are mappings by column
    return {key: value for key, value in found.items() if not isinstance(value, Mapping)}


def packing_of_column(attributes: Any, name: str) -> dict[str, Any]:
    """The attributes of a column among those of its table.

    They are `{"speed": {"scale_factor": 0.1}}` or `{"scale_factor": {"speed": 0.1}}`.
    """
    found: dict[str, Any] = {}
    for key, value in attributes.items():
        held = mapping_of(value)
        if text_of(key) == PANDAS_ATTRIBUTES:
            found |= packing_of_column(held, name)
        elif text_of(key) == name:
            found |= packing_in(held)
        elif text_of(key) in _KEYS and name in held:
            found[text_of(key)] = held[name]
    return found


def with_netcdf_fill(packing: Mapping[str, Any], dtype: np.dtype[Any]) -> Mapping[str, Any]:
    """The attributes with the number that NetCDF has where nobody wrote one, without an attribute.

    Source: NC_FILL_* of netcdf.h; numbers of one byte have none.
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
    """array * scale_factor + add_offset, NaN where the packed number is missing or not valid.

    Source: CF conventions 1.11, sections 2.5.1 and 8.1. Fill values and limits are those of packed
    numbers. Arrays that hold no numbers stay as they are. Raises PackingError.
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
    """The attributes that scale or shift numbers, for messages; empty where they change none.

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
    """The numbers of an attribute, of which Parquet has the text; none where it is not there."""
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
