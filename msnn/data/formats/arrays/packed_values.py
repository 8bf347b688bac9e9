"""Unpacks stored values by attributes such as `scale_factor`, as the CF conventions define."""

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
    """Values cannot be unpacked because of an attribute; the text gives the reason."""


def packing_in(attributes: Any) -> dict[str, Any]:
    """The attributes for unpacking, selected from the attributes of an array or a column."""
    # others are not even read: references of HDF5 cannot be
    found = {text_of(key): attributes[key] for key in attributes if text_of(key) in _KEYS}
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
        elif text_of(key) in _KEYS and name in held:
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
