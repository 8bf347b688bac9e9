"""Reads the weights of sub-models as untrusted input; errors point to the `weights:` of the
spec.
"""

from __future__ import annotations

import hashlib
import json
import shlex
from collections.abc import Iterator, Mapping
from dataclasses import field
from pathlib import Path
from typing import Any

import numpy as np

from msnn.data.dataset import FloatArray
from msnn.model.number_files import number_parts, number_texts
from msnn.model.saved_run import LATEST
from msnn.model.spec_hash import hash_of, parts_of
from msnn.model.weights.safetensors_file import WeightsFault, arrays_in
from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.errors import submodels as errors
from spec_schema.late_dataclass import dataclass
from spec_schema.reading.reader import ReadResult, refuse_endless
from spec_schema.sections.submodels import Use

LARGEST_FILE = 1 << 30
"""Maximum size of a weights file in bytes."""


@dataclass(frozen=True)
class SubmodelWeights:
    """Arrays of every sub-model that has `weights:`, and the SHA-256 of the files they come
    from.
    """

    arrays: dict[str, Mapping[str, FloatArray]] = field(
        default_factory=dict[str, Mapping[str, FloatArray]]
    )
    digests: dict[str, str] = field(default_factory=dict[str, str])
    files: dict[str, Path] = field(default_factory=dict[str, Path])


def read_submodel_weights(
    read: ReadResult,
    findings: Findings,
    kept: Mapping[str, Path] | None = None,
    texts: Mapping[str, str] | None = None,
) -> SubmodelWeights:
    """Reads the `weights:` files of a spec's sub-models, including nested ones.

    `kept` maps full names of sub-models to saved copies of these files. `texts` are the saved texts
    of files of initial values.
    """
    found = SubmodelWeights()
    for name, use, file, parent in _uses(read, ""):
        if use.weights is not None:
            path = Path(parent.source.path).parent / use.weights.value
            path = path if kept is None else kept[name]
            _read(name, use, _File(file, path, texts), found, findings)
    return found


def _uses(read: ReadResult, prefix: str) -> Iterator[tuple[str, Use, ReadResult, ReadResult]]:
    """Yields full name, use, its file and the file that uses it; nested sub-models first."""
    for name, use in read.spec.use.items():
        file = read.used[name]
        # inner ones first: the hash that an outer file was written for counts their digests
        yield from _uses(file, f"{prefix}{name}.")
        yield prefix + name, use, file, read


@dataclass(frozen=True, slots=True)
class _File:
    """A sub-model's spec, its weights file, and saved texts of files of initial values."""

    spec: ReadResult
    weights: Path
    texts: Mapping[str, str] | None


def _read(name: str, use: Use, of: _File, found: SubmodelWeights, findings: Findings) -> None:
    assert use.weights is not None
    place, file, path = use.weights.span, of.spec, of.weights
    try:
        content = _content(path)
    except (OSError, ValueError) as error:
        reason = (getattr(error, "strerror", None) or str(error)).lower()
        command = f"msnn train {file.source.path}{_where(path)}"
        repair = f"train it first: `{command}`, or leave `weights:` out"
        problem = f"cannot read {path}: {reason}"
        findings.report(errors.unusable_weights(name, problem, place, repair))
        return
    try:
        arrays = arrays_in(content)
    except WeightsFault as fault:
        problem = f"cannot read {path}: {fault}"
        findings.report(errors.unusable_weights(name, problem, place, None))
        return
    # of the very bytes that were read: the file may change meanwhile
    found.digests[name] = hashlib.sha256(content).hexdigest()
    found.files[name] = path
    found.arrays[name] = {
        array: values.astype(np.float64)
        for array, values in arrays.items()
        if np.issubdtype(values.dtype, np.floating)
    }
    # every array is told of, not the first alone
    for array, values in arrays.items():
        problem = None
        if array not in found.arrays[name]:
            problem = f"`{array}` holds {values.dtype} values, not floating point numbers"
        elif not np.all(np.isfinite(values)):
            problem = f"`{array}` has values that are not finite"
        if problem is not None:
            findings.report(errors.unusable_weights(name, problem, place, None))
    written_for = _metadata(content).get("spec_sha256")
    inner = {
        inner.removeprefix(f"{name}."): digest
        for inner, digest in found.digests.items()
        if inner.startswith(f"{name}.")
    }
    parts = (*parts_of(file, inner), *number_parts(number_texts(file, of.texts)))
    if written_for in (None, hash_of(file.source.text, parts)):
        return
    from msnn.model.trained_model import is_of_this_model  # only texts that differ need it

    if not is_of_this_model(file, parts, path):
        findings.report(errors.weights_of_other_text(name, use.file.value, place))


def _where(weights: Path) -> str:
    """The option `--out` with which a training saves its weights as `OUT/NAME/latest`; else
    empty.
    """
    above = weights.parents
    if len(above) < 4 or above[0].name != LATEST or above[2] == Path("runs"):
        return ""
    return f" --out {shlex.quote(str(above[2]))}"


def _content(path: Path) -> bytes:
    """The bytes of a regular file. Raises ValueError for a device, a pipe or a file over the
    limit.
    """
    if not path.exists():
        message = "no such file"
        raise ValueError(message)
    # a pipe would wait for ever
    if not path.is_file() or path.stat().st_size > LARGEST_FILE:
        message = "it is not a file of weights"
        raise ValueError(message)
    refuse_endless(path)
    return path.read_bytes()


def _metadata(content: bytes) -> Mapping[str, Any]:
    """The metadata of a safetensors header, whose length and JSON syntax `load` has checked."""
    length = int.from_bytes(content[:8], "little")
    header: dict[str, Any] = json.loads(content[8 : 8 + length])
    return header.get("__metadata__", {})
