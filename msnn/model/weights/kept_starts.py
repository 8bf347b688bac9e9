"""Saves the initial states of the training recordings next to the weights."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, cast, runtime_checkable

import numpy as np

from backends.files.atomic_write import write_bytes
from backends.files.disk_arrays import AT_ONCE
from backends.files.safetensors_bytes import safetensors_bytes
from msnn.data.dataset import BoolArray, Dataset, FloatArray, IntArray, Record
from msnn.model.weights.safetensors_file import WeightsFault, arrays_in
from msnn.model.weights.weights_file import Weights, weights_path
from spec_schema.reading.reader import refuse_endless

STARTS = "starts.safetensors"
_START, _SIGNAL = "start of ", "recorded "
_RUN, _WEIGHTS = "record and row", "weights"


@dataclass(frozen=True, slots=True, kw_only=True)
class KeptStarts:
    """Estimated initial states of rollouts, with hashes that find their recordings in other
    data.
    """

    recorded: Mapping[str, IntArray]
    """A hash of the values of each signal in every recording."""
    run: IntArray
    """(runs, 2): index of the recording, and the row in it at which the run begins."""
    values: Mapping[str, FloatArray]
    """(runs, *shape) per state."""
    weights: int
    """A hash of the weights to which they belong."""

    @classmethod
    def of(
        cls,
        data: Dataset,
        signals: Iterable[str],
        t0: IntArray,
        values: Mapping[str, FloatArray],
        weights: Mapping[str, FloatArray],
    ) -> KeptStarts:
        """The initial states of runs from rows t0; they depend on these signals."""
        record, row = _places(data, t0)
        recorded = {
            name: np.array([_number(data, name, one) for one in data.records], np.int64)
            for name in sorted(signals)
        }
        return cls(
            recorded=recorded,
            run=np.stack([record, row], axis=1),
            values=dict(values),
            weights=_number_of(weights),
        )

    def is_of(self, shapes: Mapping[str, tuple[int, ...]]) -> bool:
        """True if the saved values have these states with these shapes."""
        return shapes == {name: one.shape[1:] for name, one in self.values.items()}

    def at(self, data: Dataset, t0: IntArray) -> tuple[BoolArray, Mapping[str, FloatArray]]:
        """The mask (runs,) of rollouts, beginning at rows `t0`, with saved initial states, and
        these by state.
        """
        record, row = _places(data, t0)
        same = self._same_recordings(data, np.unique(record))
        known = {(int(r), int(k)): place for place, (r, k) in enumerate(self.run)}
        place = np.array(
            [
                known.get((same.get(r, -1), k), -1)
                for r, k in zip(record.tolist(), row.tolist(), strict=True)
            ],
            np.int64,
        )
        return place >= 0, {name: values[place] for name, values in self.values.items()}

    def _same_recordings(self, data: Dataset, records: IntArray) -> dict[int, int]:
        """Maps recordings to the training recording with identical values."""
        if not all(name in data.series for name in self.recorded):
            return {}
        names = sorted(self.recorded)
        kept = np.stack([self.recorded[name] for name in names], axis=1).tolist()
        found: dict[int, int] = {}
        for record in map(int, records):
            numbers = [_number(data, name, data.records[record]) for name in names]
            if numbers in kept:
                found[record] = kept.index(numbers)
        return found


def _places(data: Dataset, t0: IntArray) -> tuple[IntArray, IntArray]:
    """The recording of each row, and the row within it."""
    begins = np.array([record.start for record in data.records], np.int64)
    record = np.searchsorted(begins, t0, side="right") - 1
    return record, t0 - begins[record]


def _number(data: Dataset, signal: str, record: Record) -> int:
    """A hash of a signal's values in a recording: the first bytes of their SHA-256."""
    hashed = hashlib.sha256()
    # in parts: series on disk may have more rows than memory
    for begin in range(record.start, record.stop, AT_ONCE):
        rows = data.series[signal][begin : min(begin + AT_ONCE, record.stop)]
        hashed.update(np.ascontiguousarray(rows, np.float64).tobytes())
    return _first(hashed.digest())


def _number_of(weights: Mapping[str, FloatArray]) -> int:
    hashed = hashlib.sha256()
    for name in sorted(weights):
        hashed.update(name.encode())
        hashed.update(np.ascontiguousarray(weights[name], np.float64).tobytes())
    return _first(hashed.digest())


def _first(digest: bytes) -> int:
    return int.from_bytes(digest[:8], "little", signed=True)


def write_starts(path: Path, found: KeptStarts) -> Path:
    """Writes the initial states as a safetensors file."""
    arrays = {_RUN: found.run, _WEIGHTS: np.array([found.weights], np.int64)}
    arrays |= {f"{_SIGNAL}{name}": one for name, one in found.recorded.items()}
    starts = {f"{_START}{name}": np.asarray(one, float) for name, one in found.values.items()}
    return write_bytes(path, safetensors_bytes({**arrays, **starts}, {"format": "msnn-starts-1"}))


@runtime_checkable
class _HasStarts(Protocol):
    """An object like the result of `train`, with initial states."""

    @property
    def starts(self) -> KeptStarts | None: ...


def known_starts(weights: Weights | None, known: Mapping[str, FloatArray]) -> KeptStarts | None:
    """The saved initial states next to a weights file or in a result of `train`.

    None if there are none, or if they belong to other values than `known`, those of the weights.
    """
    found: KeptStarts | None = None
    if isinstance(weights, str | Path):
        found = _read(weights_path(weights).with_name(STARTS))
    elif isinstance(cast("object", weights), _HasStarts):
        found = cast("_HasStarts", weights).starts
    return found if found is not None and found.weights == _number_of(known) else None


def _read(path: Path) -> KeptStarts | None:
    """The contents of a file; None if it is missing or damaged."""
    try:
        refuse_endless(path)
        arrays = arrays_in(path.read_bytes())
    except (OSError, WeightsFault):
        return None
    recorded = {name: one.astype(np.int64) for name, one in _named(arrays, _SIGNAL).items()}
    values = _named(arrays, _START)
    run, weights = arrays.get(_RUN), arrays.get(_WEIGHTS)
    # untrusted, like every file
    if run is None or weights is None or run.ndim != 2 or run.shape[1] != 2 or weights.size != 1:
        return None
    if not recorded or not values or any(len(one) != len(run) for one in values.values()):
        return None
    if not all(np.all(np.isfinite(one)) for one in values.values()):
        return None
    return KeptStarts(recorded=recorded, run=run, values=values, weights=int(weights[0]))


def _named(arrays: Mapping[str, FloatArray], prefix: str) -> dict[str, FloatArray]:
    return {n.removeprefix(prefix): one for n, one in arrays.items() if n.startswith(prefix)}
