"""Describes a run for `run.json`: its stages, spec, data and versions, and what its bits
depend on.
"""

from __future__ import annotations

import hashlib
import json
import platform
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from functools import cache
from importlib.metadata import version
from typing import Any, cast

import numpy as np

from backends.files.disk_arrays import blocks
from backends.native.compile_kernel import KernelDescription, kernel_description
from compiler.differentiation.estimated_starts import estimated_states
from compiler.ir.program import Program
from msnn.data.dataset import Dataset
from msnn.model.model_files import SubmodelFile
from msnn.packages import TORCH
from msnn.training.plans.stage_plan import StagePlan
from msnn.training.plans.stage_result import StageResult
from msnn.training.records.progress import StageEnd
from spec_schema.fields.entry import Entry
from spec_schema.fields.leaf import Located
from spec_schema.version import __version__

_FORMAT = 1
_SAME_BITS = frozenset({"threads"})
"""Keys of a stage that do not affect results."""


def run_record(
    program: Program, plans: Sequence[StagePlan], data: Dataset, parts: Sequence[SubmodelFile] = ()
) -> dict[str, Any]:
    """The content of `run.json`: resolved stages, hashes of spec and data, versions,
    reproducibility.
    """
    plugins = {suffix: asdict(plugin) for suffix, plugin in data.plugins.items()}
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
            **({"plugins": plugins} if plugins else {}),
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
    """The differences between two records of runs that prevent resuming, one line each.

    Example: `train.0.epochs: 6, now 8`.
    """
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


_LAPACK = "LAPACK of numpy and the processor"
_TORCH = "torch and the processor"
_NOT_FLOAT32 = "what made a kernel wrong here in float32, so that the stage ran in float64"


def bits_record(program: Program, plans: Sequence[StagePlan]) -> dict[str, Any]:
    """The kernel build, and if the weights are bitwise reproducible on other machines.

    `reproducible` is true if another compiler and another processor with fused multiply-add give
    the same bits. Otherwise `depends_on` names the cause per stage and per fitted layer.
    """
    native = any(plan.engine != "torch" for plan in plans)
    kernels = kernel_description() if native else None
    reasons = {fit.layer: _LAPACK for fit in program.fits}
    reasons |= {plan.name: reason for plan in plans if (reason := _depends_on(plan, kernels))}
    return {
        "reproducible": not reasons,
        "depends_on": reasons,
        "kernels": None if kernels is None else asdict(kernels),
    }


def as_it_ran(record: Mapping[str, Any], plan: StagePlan) -> dict[str, Any]:
    """The entry `bits` of `run.json` after a stage did not use the kernel that was planned."""
    reason = _TORCH if plan.engine == "torch" else _NOT_FLOAT32
    depends_on = {**record.get("depends_on", {}), plan.name: reason}
    return {**record, "reproducible": False, "depends_on": depends_on}


def _depends_on(plan: StagePlan, kernels: KernelDescription | None) -> str:
    """The software besides msnn that determines the bits of a stage, as a text; empty if there is
    none.
    """
    if plan.engine == "torch" or kernels is None:
        return _TORCH
    match plan.optimizer.steps_by:
        case "torch":
            return _TORCH
        case "LAPACK":
            return _LAPACK
        case "kernel" if kernels.fuses or plan.reproducible:
            return ""
        case "kernel":
            return "the processor: it has no fused multiply-add"


def stage_record(plan: StagePlan) -> dict[str, object]:
    """The plan of a stage as a JSON object, with every default filled in."""
    return {
        "name": plan.name,
        "epochs": plan.epochs,
        "batch": plan.batch,
        "optimizer": _variant(plan.optimizer),
        "rollout": {
            "horizon": plan.rollout.horizon,
            "stride": plan.rollout.stride,
            "skip": plan.rollout.skip,
            "warm_up": plan.rollout.warm_up,
            "starts": _starts(plan),
            "close": list(plan.rollout.closed),
            "curriculum": {str(phase.until): phase.horizon for phase in plan.phases},
        },
        "skip_rows": plan.rollout.skip_rows,
        "losses": dict(plan.loss_weights),
        **({"losses_by_variance": True} if plan.weighs_by_variance else {}),
        "trained": list(plan.trained),
        "priors": _priors(plan),
        "scales": _scales(plan),
        "lr": dict(plan.lr_factors),
        "schedule": None if plan.schedule is None else _variant(plan.schedule),
        "clip": plan.clip,
        "weight_decay": plan.weight_decay,
        "monitor": plan.monitor,
        "patience": plan.patience,
        "seed": plan.seed,
        "dtype": plan.dtype,
        "engine": plan.engine,
        "device": plan.device,
        "threads": plan.threads,
        "reproducible": plan.reproducible,
        "starts": plan.attempts,
    }


def stage_end(plan: StagePlan, result: StageResult) -> StageEnd:
    """The `StageEnd` event for the result of a stage."""
    return StageEnd(
        stage=plan.name,
        attempt=result.attempt + 1,
        attempts=plan.attempts,
        epochs=result.epochs,
        best=result.best_value,
        best_epoch=result.best_epoch,
        seconds=result.seconds,
        reason=result.reason,
    )


def _scales(plan: StagePlan) -> dict[str, object]:
    moved = (plan.program.parameter(name) for name in plan.trained)
    return {p.name: p.scale for p in moved if p.scales_by_data}


def _priors(plan: StagePlan) -> dict[str, object]:
    moved = (plan.program.parameter(name) for name in plan.trained)
    return {p.name: asdict(p.prior) for p in moved if p.prior is not None}


def _starts(plan: StagePlan) -> dict[str, object] | None:
    """The states whose initial values are estimated, and the method."""
    starts = plan.rollout.starts
    if starts is None:
        return None
    names = [state.name for state in estimated_states(starts.program)]
    return {"states": names, "over": starts.over, "with_parameters": plan.estimates_starts}


def _variant(options: Entry) -> dict[str, object]:
    name = options.noun.split()[-2]  # the adam optimizer, the cosine schedule
    keys = (key for key in type(options).model_fields if key != "place")
    return {name: {key: _plain(getattr(options, key)) for key in keys}}


def _plain(value: object) -> object:
    match value:
        case Located():
            return value.value
        case dict():
            return {name: _plain(found) for name, found in value.items()}
        case _:
            return value
