"""Saves the progress of a run in a file, from which training continues with the same bits.

The file contains arrays and JSON, and no code.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from safetensors import SafetensorError, safe_open

from backends.files.atomic_write import write_bytes
from backends.files.safetensors_bytes import safetensors_bytes
from msnn.data.dataset import FloatArray
from msnn.errors.learning import training as errors
from msnn.simulation.rollout import LossSum
from msnn.training.engines.engine import EngineState, LossSums
from msnn.training.plans.epochs import Reductions
from msnn.training.plans.stage_result import EstimatedStarts, StageResult
from spec_schema.diagnostics.diagnostic import SpecError

# incremented when the content changes: older checkpoints are refused
_FORMAT = 6
_RESULT = ("best_value", "best_epoch", "epochs", "reason", "seconds", "attempt")


@dataclass(frozen=True, slots=True, kw_only=True)
class TrainingPosition:
    """The progress within one attempt at a stage, with the state of its engine and the best
    weights.
    """

    epoch: int
    """Completed epochs of the attempt."""
    batch: int
    """Completed batches of the current epoch."""
    sums: LossSums
    """Losses of these batches."""
    left_out: int
    """Batches skipped because of infinite derivatives."""
    best_value: float
    best_epoch: int
    best: Mapping[str, FloatArray]
    engine: EngineState
    reductions: Reductions
    """Reductions of the learning rate so far."""
    spread: float
    """Weight of priors in the current epoch."""
    found_rate: float
    """The learning rate if it was searched, else 1."""
    seconds: float
    """Since the attempt began, without interruptions."""
    starts: Mapping[str, FloatArray] = field(default_factory=dict[str, FloatArray])
    """Initial states of the runs in the incomplete epoch, per estimated state."""
    best_starts: EstimatedStarts | None = None
    """Initial states that belong to the best weights, if training estimates them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Checkpoint:
    """The progress of a run: the results of completed stages, and the state of the current one."""

    ended: tuple[StageResult, ...]
    """Results of the completed stages; the current stage is the next one."""
    begin: Mapping[str, FloatArray]
    """The initial weights of the current stage."""
    attempt: int = 0
    leader: StageResult | None = None
    """The best of the earlier attempts."""
    place: TrainingPosition | None = None
    """None if the attempt has not begun."""
    metrics: int = 0
    """Size of `metrics.jsonl` in bytes at this position."""


def write_checkpoint(path: Path, checkpoint: Checkpoint) -> None:
    """Writes a checkpoint to `path`; the old file is replaced only when the new one is complete."""
    arrays = _above("begin", checkpoint.begin)
    results = {f"ended{number}": each for number, each in enumerate(checkpoint.ended)}
    if checkpoint.leader is not None:
        results["leader"] = checkpoint.leader
    for name, result in results.items():
        arrays |= _above(name, result.best) | _of_starts(name, result.starts)
    record: dict[str, Any] = {
        "format": _FORMAT,
        "ended": len(checkpoint.ended),
        "results": {n: [getattr(each, key) for key in _RESULT] for n, each in results.items()},
        "attempt": checkpoint.attempt,
        "metrics": checkpoint.metrics,
        "place": None,
    }
    if checkpoint.place is not None:
        place = checkpoint.place
        arrays |= _above("best", place.best) | _above("engine", place.engine.arrays)
        arrays |= _above("starts", place.starts) | _of_starts("best", place.best_starts)
        record["place"] = {
            "epoch": place.epoch,
            "batch": place.batch,
            "sums": {name: [s.total, s.count] for name, s in place.sums.items()},
            "left_out": place.left_out,
            "best_value": place.best_value,
            "best_epoch": place.best_epoch,
            "engine": place.engine.structure,
            "spread": place.spread,
            "found_rate": place.found_rate,
            "reductions": [place.reductions.count, place.reductions.epoch],
            "seconds": place.seconds,
        }
    text = json.dumps(record)
    metadata = {"msnn": text, "sha256": _digest(text, arrays)}
    write_bytes(path, safetensors_bytes(arrays, metadata), durable=True)


def read_checkpoint(path: Path) -> Checkpoint:
    """Reads a checkpoint; SpecError if the file is damaged or of another version of the format."""
    try:
        with safe_open(path, framework="numpy") as file:
            metadata = file.metadata() or {}
            arrays: dict[str, Any] = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        record = json.loads(metadata["msnn"])
        if record["format"] != _FORMAT:
            raise ValueError(record["format"])
        # a flipped bit would silently lead to other weights
        if metadata["sha256"] != _digest(metadata["msnn"], arrays):
            reason = f"{path.name} is damaged: its content is not what was written"
            raise SpecError((errors.other_checkpoint(str(path.parent), reason),))
        results = {
            name: _result(values, _below(name, arrays), _starts(name, arrays))
            for name, values in record["results"].items()
        }
        return Checkpoint(
            ended=tuple(results[f"ended{number}"] for number in range(int(record["ended"]))),
            begin=_below("begin", arrays),
            attempt=int(record["attempt"]),
            leader=results.get("leader"),
            place=None if record["place"] is None else _place(record["place"], arrays),
            metrics=int(record["metrics"]),
        )
    except (OSError, SafetensorError, KeyError, ValueError, TypeError, OverflowError) as error:
        reason = f"{path.name} is not a checkpoint of this version"
        raise SpecError((errors.other_checkpoint(str(path.parent), reason),)) from error


def _digest(record: str, arrays: Mapping[str, Any]) -> str:
    """The SHA-256 of the record and of each array with its name, type and shape."""
    digest = hashlib.sha256(record.encode())
    for name, values in sorted(arrays.items()):
        digest.update(f"{name} {values.dtype.str} {values.shape}\n".encode())
        digest.update(np.ascontiguousarray(values).tobytes())
    return digest.hexdigest()


def _place(record: Mapping[str, Any], arrays: Mapping[str, FloatArray]) -> TrainingPosition:
    return TrainingPosition(
        epoch=int(record["epoch"]),
        batch=int(record["batch"]),
        sums={name: LossSum(float(t), float(n)) for name, (t, n) in record["sums"].items()},
        left_out=int(record["left_out"]),
        best_value=float(record["best_value"]),
        best_epoch=int(record["best_epoch"]),
        best=_below("best", arrays),
        engine=EngineState(_below("engine", arrays), record["engine"]),
        spread=float(record["spread"]),
        found_rate=float(record["found_rate"]),
        reductions=Reductions(*map(int, record["reductions"])),
        seconds=float(record["seconds"]),
        starts=_below("starts", arrays),
        best_starts=_starts("best", arrays),
    )


def _of_starts(name: str, starts: EstimatedStarts | None) -> dict[str, Any]:
    """The arrays of the initial states that belong to the weights of this name."""
    if starts is None:
        return {}
    runs = {"t0": starts.t0, "steps": starts.steps}
    return _above(f"{name} runs", runs) | _above(f"{name} starts", starts.values)


def _starts(name: str, arrays: Mapping[str, Any]) -> EstimatedStarts | None:
    runs = _below(f"{name} runs", arrays)
    if not runs:
        return None
    values = _below(f"{name} starts", arrays)
    t0, steps = (np.asarray(runs[key], np.int64) for key in ("t0", "steps"))
    return EstimatedStarts(t0=t0, steps=steps, values=values)


def _above(prefix: str, arrays: Mapping[str, Any]) -> dict[str, Any]:
    """The arrays with a prefix before their names."""
    return {f"{prefix}:{name}": np.asarray(values) for name, values in arrays.items()}


def _below(prefix: str, arrays: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """The arrays whose names have the prefix, without the prefix."""
    begin = f"{prefix}:"
    return {n.removeprefix(begin): a for n, a in arrays.items() if n.startswith(begin)}


def _result(
    record: list[Any], best: Mapping[str, FloatArray], starts: EstimatedStarts | None
) -> StageResult:
    value, best_epoch, epochs, reason, seconds, attempt = record
    return StageResult(
        best=best,
        best_value=float(value),
        best_epoch=int(best_epoch),
        epochs=int(epochs),
        reason=str(reason),
        seconds=float(seconds),
        attempt=int(attempt),
        starts=starts,
    )
