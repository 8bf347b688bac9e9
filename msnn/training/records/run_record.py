"""Records the origin of a run in `run.json`, and finds changes since then."""

from __future__ import annotations

import hashlib
import json
import platform
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from importlib.metadata import version
from typing import Any, cast

import numpy as np

from backends.files.disk_arrays import blocks
from compiler.ir.program import Program
from msnn.data.dataset import Dataset
from msnn.model.spec_hash import SubmodelFile
from msnn.packages import TORCH
from msnn.training.plans.stage_plan import StagePlan
from msnn.training.records.bits_record import bits_record
from msnn.training.records.stage_record import stage_record
from spec_schema.version import __version__

_FORMAT = 1
_SAME_BITS = frozenset({"threads"})
"""Keys of a stage that do not affect results."""


def run_record(
    program: Program, plans: Sequence[StagePlan], data: Dataset, parts: Sequence[SubmodelFile] = ()
) -> dict[str, Any]:
    """The resolved stages, hashes of spec and data, versions, and reproducibility."""
    return {
        "format": _FORMAT,
        "program": program.name,
        "spec_sha256": program.spec_hash,
        "parts": {part.name: part.record() for part in parts},
        "versions": _versions(),
        **({"plugins": {p.package: p.version for p in program.plugins}} if program.plugins else {}),
        "bits": bits_record(program, plans),
        "stages": [stage_record(plan) for plan in plans],
        "data": {
            "files": [record.file for record in data.records],
            "rows": {name: int(data.in_set(name).sum()) for name in data.sets},
            "sha256": data_hash(data),
        },
    }


@cache
def _versions() -> dict[str, str]:
    return {
        "msnn": __version__,
        "python": platform.python_version(),
        "numpy": version("numpy"),
        **({TORCH.name: version(TORCH.name)} if TORCH.is_installed else {}),
    }


def differences(before: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """Differences that prevent resuming a run, one line each: `train.0.epochs: 6, now 8`."""
    found: list[str] = []
    now = json.loads(json.dumps(now))  # lists, not tuples: as it is read back
    if before.get("spec_sha256") != now["spec_sha256"]:
        found += _changed_parts(before, now) or ["the spec has changed"]
    stages = (_leaves(each.get("stages"), "train") for each in (before, now))
    old, new = (dict(leaves) for leaves in stages)
    for path in dict.fromkeys((*old, *new)):
        if old.get(path) != new.get(path) and path.rpartition(".")[2] not in _SAME_BITS:
            found.append(f"{path}: {_said(old, path)}, now {_said(new, path)}")
    hashes = (dict(_leaves(each.get("data"), "")).get(".sha256") for each in (before, now))
    if len(set(hashes)) > 1:
        found.append("the data have changed")
    return found


def _changed_parts(before: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """The sub-models whose texts or weights differ."""
    old, new = (dict(_leaves(each.get("parts", {}), "")) for each in (before, now))
    changed = [path for path in dict.fromkeys((*old, *new)) if old.get(path) != new.get(path)]
    what = {"spec_sha256": "the spec", "weights_sha256": "the weights"}
    what["numbers_sha256"] = "the numbers"
    leaves = (path[1:].rpartition(".") for path in changed)
    return [f"{what[key]} of `{part}` changed" for part, _, key in leaves if key in what]


def _leaves(value: Any, path: str) -> Iterator[tuple[str, Any]]:
    match value:
        case dict():
            for key, part in cast("dict[str, Any]", value).items():
                yield from _leaves(part, f"{path}.{key}")
        case list():
            for number, part in enumerate(cast("list[Any]", value)):
                yield from _leaves(part, f"{path}.{number}")
        case _:
            yield path, value


def _said(leaves: Mapping[str, Any], path: str) -> str:
    value = leaves.get(path)
    return "not given" if value is None else str(value)


def data_hash(data: Dataset) -> str:
    """The hash of all series, their sets and gaps, independent of their files."""
    digest = hashlib.sha256()
    for name, series in sorted(data.series.items()):
        digest.update(f"{name}{series.shape}".encode())
        for part in blocks(series):
            digest.update(np.ascontiguousarray(part).tobytes())
    digest.update(",".join(data.sets).encode())
    for rows in (data.set_of_row, data.continues, data.usable):
        for part in blocks(rows):
            digest.update(np.ascontiguousarray(part).tobytes())
    return digest.hexdigest()
