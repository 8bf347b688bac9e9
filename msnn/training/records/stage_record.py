"""Describes a stage as plain data, for the record of a run."""

from __future__ import annotations

from dataclasses import asdict

from compiler.differentiation.estimated_starts import estimated_states
from msnn.training.plans.stage_plan import StagePlan
from msnn.training.plans.stage_result import StageResult
from msnn.training.records.progress import StageEnd
from spec_schema.fields.entry import Entry
from spec_schema.fields.leaf import Located


def stage_record(plan: StagePlan) -> dict[str, object]:
    """The stage with every default filled in."""
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
    """The event for a completed stage."""
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
