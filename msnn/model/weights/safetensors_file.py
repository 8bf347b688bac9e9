"""Reads the arrays of an untrusted safetensors file."""

from __future__ import annotations

import json
from typing import Any, cast

from numpy.typing import NDArray

_HEADER_STARTS = 8
"""Size in bytes of the little-endian header length; the header is JSON."""


class WeightsFault(Exception):  # noqa: N818  (the reason that a message gives)
    """The bytes are not a weights file; the text gives the reason."""


def arrays_in(content: bytes) -> dict[str, NDArray[Any]]:
    """The arrays by name. Raises WeightsFault with the error in the bytes."""
    # only here: most commands read no weights
    from safetensors import SafetensorError
    from safetensors.numpy import load

    try:
        return load(content)
    # KeyError of a dtype that numpy does not have
    except (SafetensorError, ValueError, KeyError) as error:
        raise WeightsFault(_fault(content)) from error


def _fault(content: bytes) -> str:
    """The error in unreadable bytes; format: huggingface.co/docs/safetensors."""
    if not content:
        return "it is empty"
    if content.startswith(b"version https://git-lfs"):
        return "it is a pointer of Git LFS: `git lfs pull` brings the file itself"
    if content.startswith(b"PK\x03\x04"):
        return "it is a zip archive, as torch.save and numpy.savez write: save it as safetensors"
    size = int.from_bytes(content[:_HEADER_STARTS], "little")
    if len(content) <= _HEADER_STARTS or content[_HEADER_STARTS : _HEADER_STARTS + 1] != b"{":
        return "it is not a safetensors file"
    begin = _HEADER_STARTS + size
    if begin > len(content):
        return f"it is cut off in its header: {begin:,} bytes of {len(content):,}"
    try:
        header = json.loads(content[_HEADER_STARTS:begin])
        ends = [
            (name, int(entry["data_offsets"][1]), str(entry["dtype"]))
            for name, entry in cast("dict[str, Any]", header).items()
            if name != "__metadata__"
        ]
    except (ValueError, TypeError, KeyError, AttributeError, IndexError, RecursionError):
        return "its header is damaged"
    end = begin + max((end for _, end, _ in ends), default=0)
    if end > len(content):
        return f"it is cut off: its arrays need {end:,} bytes, it has {len(content):,}"
    if end < len(content):
        return f"{len(content) - end:,} bytes follow its last array"
    unlike = [(name, dtype) for name, _, dtype in ends if dtype not in _DTYPES]
    if unlike:
        name, dtype = unlike[0]
        return f"`{name}` has the dtype {dtype}, of which numpy has none: save it as float32"
    return "its header is damaged: sizes and places of its arrays do not fit"


_DTYPES = ("F64", "F32", "F16", "I64", "I32", "I16", "I8", "U64", "U32", "U16", "U8", "BOOL")
"""Those that numpy reads."""
