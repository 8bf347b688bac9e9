"""Where a run stands, on disk: enough to go on bit for bit, and nothing that could run as code."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from safetensors import SafetensorError, safe_open

from backends.files.atomic_write import write_bytes
from backends.files.safetensors_bytes import safetensors_bytes
from msnn.data.dataset import FloatArray
from msnn.errors import training as errors
from msnn.simulation.rollout import LossSum
from msnn.training.engines.engine import EngineState, LossSums
from msnn.training.plans.learning_rate import Reductions
from msnn.training.plans.stage_result import StageResult
from spec_schema.diagnostics.diagnostic import SpecError

_FORMAT = 1
_LEADER = ("best_value", "best_epoch", "epochs", "reason", "seconds", "attempt")


@dataclass(frozen=True, slots=True)
class Checkpoint:
    """The position inside a stage, the engine there, and the best weights so far."""

    spec_hash: str
    stage: int
    attempt: int
    epoch: int
    """Epochs of the stage that are complete."""
    batch: int
    """Batches of the next epoch that are done."""
    sums: LossSums
    """Losses of these batches."""
    best_value: float
    best_epoch: int
    best: Mapping[str, FloatArray]
    engine: EngineState
    leader: StageResult | None
    """The best of the attempts before this one."""
    reductions: Reductions
    """Of the learning rate so far."""


def write_checkpoint(path: Path, checkpoint: Checkpoint) -> None:
    """Writes the file whole or not at all."""
    arrays = {f"best/{name}": np.asarray(v) for name, v in checkpoint.best.items()}
    leader = checkpoint.leader
    if leader is not None:
        arrays |= {f"leader/{name}": np.asarray(v) for name, v in leader.best.items()}
    arrays |= {f"engine{name}": np.asarray(v) for name, v in checkpoint.engine.arrays.items()}
    record = {
        "format": _FORMAT,
        "spec_hash": checkpoint.spec_hash,
        "stage": checkpoint.stage,
        "attempt": checkpoint.attempt,
        "epoch": checkpoint.epoch,
        "batch": checkpoint.batch,
        "sums": {name: [s.total, s.count] for name, s in checkpoint.sums.items()},
        "best_value": checkpoint.best_value,
        "best_epoch": checkpoint.best_epoch,
        "engine": checkpoint.engine.structure,
        "reductions": [checkpoint.reductions.count, checkpoint.reductions.epoch],
        "leader": None if leader is None else [getattr(leader, name) for name in _LEADER],
    }
    write_bytes(path, safetensors_bytes(arrays, {"msnn": json.dumps(record)}))


def read_checkpoint(path: Path) -> Checkpoint:
    """What was written; SpecError for a file that is not a checkpoint of this version."""
    try:
        with safe_open(path, framework="numpy") as file:
            metadata = file.metadata() or {}
            arrays: dict[str, Any] = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        record = json.loads(metadata["msnn"])
        if record["format"] != _FORMAT:
            raise ValueError(record["format"])
        return Checkpoint(
            spec_hash=record["spec_hash"],
            stage=int(record["stage"]),
            attempt=int(record["attempt"]),
            epoch=int(record["epoch"]),
            batch=int(record["batch"]),
            sums={name: LossSum(float(t), int(n)) for name, (t, n) in record["sums"].items()},
            best_value=float(record["best_value"]),
            best_epoch=int(record["best_epoch"]),
            best=_below("best/", arrays),
            engine=EngineState(
                _below("engine", arrays),
                record["engine"],
            ),
            leader=_leader(record["leader"], _below("leader/", arrays)),
            reductions=Reductions(*map(int, record["reductions"])),
        )
    except (OSError, SafetensorError, KeyError, ValueError, TypeError) as error:
        reason = f"{path.name} is not a checkpoint of this version"
        raise SpecError((errors.other_checkpoint(str(path.parent), reason),)) from error


def _below(prefix: str, arrays: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """The arrays whose names begin so, without that."""
    return {n.removeprefix(prefix): a for n, a in arrays.items() if n.startswith(prefix)}


def _leader(record: list[Any] | None, best: Mapping[str, FloatArray]) -> StageResult | None:
    if record is None:
        return None
    value, best_epoch, epochs, reason, seconds, attempt = record
    return StageResult(
        best,
        float(value),
        int(best_epoch),
        int(epochs),
        str(reason),
        float(seconds),
        int(attempt),
    )
